// What is felt, to a file and back; damaged and hostile files.
#include "server/state/session_file.h"

#include <gtest/gtest.h>

#include <fstream>
#include <random>
#include <sstream>

#include "server/state/session_keeper.h"
#include "tests/support/editable_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

SavedSession Session1() {
  SavedSession session;
  session.configured = {.source = "/data/lobster.nrrd",
                        .spacing_mm = Vec3(1.0 / 3.0, 1.0, 2.5),
                        .device_mm_per_volume_mm = 0.1};
  session.configured.isovalue = 2.0 / 3.0;
  session.configured_settings.method = DecompositionMethod::kBcc;
  session.configured_settings.haptics.stiffness_n_per_mm = 0.7;
  session.attempts = 2;
  LoadRequest& volume = session.felt.volume;
  volume.source = "/data/a \"head\"\n\t'''é.raw";
  volume.title = "/data/link";
  volume.spacing_mm = Vec3(0.1, 0.2, 0.3);
  volume.frame = 7;
  volume.raw = RawVoxels{
      .size = {1, 1'000'000'007, 3}, .type = "uint16", .big_endian = true, .offset_bytes = 352};
  session.felt.is_edited = true;
  RenderSettings& settings = session.felt.settings;
  settings.isovalue = -1000.0 / 3.0;
  settings.method = DecompositionMethod::kBcc;
  settings.haptics.free_side = FreeSide::kAbove;
  double value = 0.1;
  for (const NumberSetting& setting : kNumberSettings) {
    settings.haptics.*setting.member = value;
    value *= 1.7;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    settings.haptics.*setting.member = !(settings.haptics.*setting.member);
  }
  return session;
}

void ExpectSameSession(const FeltSession& read, const FeltSession& written) {
  EXPECT_EQ(read.volume.source, written.volume.source);
  EXPECT_EQ(read.volume.title, written.volume.title);
  EXPECT_EQ(read.volume.spacing_mm, written.volume.spacing_mm);
  EXPECT_EQ(read.volume.frame, written.volume.frame);
  ASSERT_EQ(read.volume.raw.has_value(), written.volume.raw.has_value());
  if (read.volume.raw) {
    EXPECT_EQ(read.volume.raw->size, written.volume.raw->size);
    EXPECT_EQ(read.volume.raw->type, written.volume.raw->type);
    EXPECT_EQ(read.volume.raw->big_endian, written.volume.raw->big_endian);
    EXPECT_EQ(read.volume.raw->offset_bytes, written.volume.raw->offset_bytes);
  }
  EXPECT_EQ(read.is_edited, written.is_edited);
  EXPECT_EQ(read.settings.isovalue, written.settings.isovalue);
  EXPECT_EQ(read.settings.method, written.settings.method);
  EXPECT_EQ(read.settings.haptics.free_side, written.settings.haptics.free_side);
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_EQ(read.settings.haptics.*setting.member, written.settings.haptics.*setting.member)
        << setting.key;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    EXPECT_EQ(read.settings.haptics.*setting.member, written.settings.haptics.*setting.member)
        << setting.key;
  }
}

class SessionFileTest : public ::testing::Test {
 protected:
  std::string Text() const {
    std::ostringstream text;
    text << std::ifstream(path_).rdbuf();
    return text.str();
  }
  void Write(const std::string& text) const { std::ofstream(path_, std::ios::binary) << text; }

  test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_.path() / "session.toml";
};

TEST_F(SessionFileTest, HoldsAllToTheBit) {
  const SavedSession written = Session1();
  WriteSessionFile(path_, written);
  const SessionFile read = ReadSessionFile(path_);
  ASSERT_TRUE(read.session) << read.damage;
  EXPECT_EQ(read.session->configured.source, written.configured.source);
  EXPECT_EQ(read.session->configured.spacing_mm, written.configured.spacing_mm);
  EXPECT_EQ(read.session->configured.device_mm_per_volume_mm,
            written.configured.device_mm_per_volume_mm);
  EXPECT_EQ(read.session->configured.isovalue, written.configured.isovalue);
  EXPECT_EQ(read.session->configured_settings.method, DecompositionMethod::kBcc);
  EXPECT_EQ(read.session->configured_settings.haptics.stiffness_n_per_mm, 0.7);
  EXPECT_EQ(read.session->attempts, 2);
  ExpectSameSession(read.session->felt, written.felt);
}

TEST_F(SessionFileTest, WhatIsNotGivenStaysSo) {
  SavedSession written;
  written.configured.source = written.felt.volume.source = "builtin:bumps";
  WriteSessionFile(path_, written);
  const SessionFile read = ReadSessionFile(path_);
  ASSERT_TRUE(read.session) << read.damage;
  EXPECT_FALSE(read.session->configured.spacing_mm);
  EXPECT_FALSE(read.session->configured.device_mm_per_volume_mm);
  ExpectSameSession(read.session->felt, written.felt);
}

// Such a path cannot be loaded again: better none than another one.
TEST_F(SessionFileTest, APathThatIsNoUtf8IsLeftOut) {
  SavedSession written = Session1();
  written.felt.volume.source = "/data/\xff\xfe.nrrd";
  WriteSessionFile(path_, written);
  const SessionFile read = ReadSessionFile(path_);
  ASSERT_TRUE(read.session) << read.damage;
  EXPECT_EQ(read.session->felt.volume.source, "");
}

TEST_F(SessionFileTest, NoFileIsNoDamage) {
  const SessionFile read = ReadSessionFile(path_);
  EXPECT_FALSE(read.session);
  EXPECT_EQ(read.damage, "");
}

TEST_F(SessionFileTest, DamagedFilesAreSaidOrHoldASession) {
  WriteSessionFile(path_, Session1());
  const std::string whole = Text();
  std::mt19937 random(7);
  int damaged = 0;
  for (int round = 0; round < 2000; ++round) {
    std::string text = whole;
    switch (round % 3) {
      case 0:
        text.resize(random() % text.size());
        break;
      case 1:
        text[random() % text.size()] = static_cast<char>(random());
        break;
      default:
        text.erase(random() % text.size(), random() % 40);
        break;
    }
    Write(text);
    const SessionFile read = ReadSessionFile(path_);
    EXPECT_TRUE(read.session || !read.damage.empty()) << text;
    damaged += !read.damage.empty();
  }
  EXPECT_GT(damaged, 200);
}

TEST_F(SessionFileTest, ASizeThatNoVolumeHasIsNone) {
  LoadRequest request;
  request.source = "/data/voxels.raw";
  request.raw = RawVoxels{.size = {64, 1234567, 2}, .type = "int16"};
  SavedSession session = Session1();
  session.felt.volume = request;
  WriteSessionFile(path_, session);
  std::string text = Text();
  const std::string number = "1234567";
  for (const char* other : {"1e300", "-1e300", "nan", "inf", "-5", "9223372036854775807"}) {
    std::string changed = text;
    changed.replace(changed.find(number), number.size(), other);
    Write(changed);
    const SessionFile read = ReadSessionFile(path_);
    ASSERT_TRUE(read.session && read.session->felt.volume.raw) << read.damage;
    EXPECT_EQ(read.session->felt.volume.raw->size, (std::array<std::int64_t, 3>{64, 0, 2}))
        << other;
  }
}

class SessionKeeperTest : public ::testing::Test {
 protected:
  void SetUp() override { data_.Load("builtin:sphere:24"); }
  std::unique_ptr<SessionKeeper> Make(const LoadRequest& configured = {.source = "builtin:bumps"},
                                      const RenderSettings& settings = {}) {
    return std::make_unique<SessionKeeper>(folder_.path(), "/run/palpate/a.sock", configured,
                                           settings, felt_);
  }
  bool IsThere() const { return std::filesystem::exists(path_); }
  // Kept, and ended out of order.
  void Leave() {
    Make()->Start();
    ASSERT_TRUE(IsThere());
  }

  test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_.path() / "sessions" / "run-palpate-a.sock.toml";
  testing::EditableSession data_;
  const SessionKeeper::Felt felt_ = [this] { return data_.session().Felt(); };
};

TEST_F(SessionKeeperTest, WhatIsLeftComesBackWithItsIsovalue) {
  EXPECT_FALSE(Make()->TakeLeft());
  Leave();
  const std::optional<FeltSession> left = Make()->TakeLeft();
  ASSERT_TRUE(left);
  ExpectSameSession(*left, data_.session().Felt());
  EXPECT_EQ(left->volume.source, "builtin:sphere:24");
  EXPECT_EQ(left->volume.isovalue, left->settings.isovalue);
}

// It may be what daemons die of, while they load it or soon after.
TEST_F(SessionKeeperTest, DaemonsThatDoNotLastWithItGiveItUp) {
  Leave();
  for (int n = 0; n < SessionKeeper::kMostAttempts; ++n) {
    const auto keeper = Make();
    EXPECT_TRUE(keeper->TakeLeft());
    if (n % 2 == 0) keeper->Start();
  }
  EXPECT_FALSE(Make()->TakeLeft());
  EXPECT_FALSE(IsThere());
  EXPECT_FALSE(Make()->TakeLeft());
}

TEST_F(SessionKeeperTest, WhatIsConfiguredOtherwiseNowIsAsConfigured) {
  Leave();
  RenderSettings settings;
  settings.haptics.stiffness_n_per_mm = 0.125;
  settings.haptics.force_shading = true;
  settings.method = DecompositionMethod::kBcc;
  const LoadRequest configured{.source = "builtin:bumps", .isovalue = 0.25};
  const std::optional<FeltSession> left = Make(configured, settings)->TakeLeft();
  ASSERT_TRUE(left);
  EXPECT_EQ(left->volume.source, "builtin:sphere:24");
  EXPECT_EQ(left->volume.isovalue, 0.25);
  EXPECT_EQ(left->settings.haptics.stiffness_n_per_mm, 0.125);
  EXPECT_TRUE(left->settings.haptics.force_shading);
  EXPECT_EQ(left->settings.method, DecompositionMethod::kBcc);
}

// Readers of the state alone, or nobody.
TEST_F(SessionKeeperTest, AFolderThatCannotBeReadStopsNothing) {
  Leave();
  std::filesystem::remove_all(path_.parent_path());
  std::filesystem::create_symlink(path_.parent_path(), path_.parent_path());
  EXPECT_FALSE(Make()->TakeLeft());
}

TEST_F(SessionKeeperTest, AnEndInOrderLeavesNothing) {
  const auto keeper = Make();
  keeper->Start();
  keeper->End();
  EXPECT_FALSE(IsThere());
}

TEST_F(SessionKeeperTest, AnEditIsKeptAsAnEdit) {
  std::mt19937 random(1);
  data_.RandomEdit(random);
  Leave();
  const std::optional<FeltSession> left = Make()->TakeLeft();
  ASSERT_TRUE(left);
  EXPECT_TRUE(left->is_edited);
}

TEST_F(SessionKeeperTest, ForAnotherConfiguredVolumeNothingComesBack) {
  Leave();
  EXPECT_FALSE(Make({.source = "builtin:gyroid"})->TakeLeft());
  EXPECT_FALSE(IsThere());
}

TEST_F(SessionKeeperTest, AnotherSocketIsAnotherSession) {
  Leave();
  SessionKeeper other(folder_.path(), "/run/palpate/b.sock", {.source = "builtin:bumps"}, {},
                      felt_);
  EXPECT_FALSE(other.TakeLeft());
  EXPECT_TRUE(IsThere());
}

TEST_F(SessionKeeperTest, WithoutAFolderNothingIsKept) {
  SessionKeeper keeper({}, "/run/palpate/a.sock", {}, {}, felt_);
  keeper.Start();
  EXPECT_FALSE(keeper.TakeLeft());
  keeper.End();
}

TEST_F(SessionKeeperTest, AFolderThatCannotBeWrittenStopsNothing) {
  std::ofstream(folder_.path() / "sessions") << "no folder";
  const auto keeper = Make();
  keeper->Start();
  keeper->End();
  EXPECT_FALSE(Make()->TakeLeft());
}

}  // namespace
}  // namespace palpate
