// What is felt, to a file and back; damaged and hostile files.

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <future>
#include <random>
#include <string>
#include <thread>
#include <tuple>

#include "server/kept/session_file.h"
#include "server/kept/session_keeper.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

SavedSession Session1() {
  SavedSession session;
  session.configured = {.source = "/data/lobster.nrrd",
                        .spacing_mm = Vec3(1.0 / 3.0, 1.0, 2.5),
                        .device_mm_per_volume_mm = 0.1};
  session.configured.isovalue = 2.0 / 3.0;
  session.configured_settings.haptics.method = DecompositionMethod::kBcc;
  session.configured_settings.haptics.stiffness_n_per_mm = 0.7;
  session.attempts = 2;
  LoadRequest& volume = session.felt.volume;
  volume.source = "/data/a \"head\"\n\t'''é.raw";
  volume.title = "/data/link";
  volume.spacing_mm = Vec3(0.1, 0.2, 0.3);
  volume.frame = 7;
  volume.raw = RawVoxels{
      .size = {1, 1'000'000'007, 3}, .type = "uint16", .big_endian = true, .offset_bytes = 352};
  RenderSettings& settings = session.felt.settings;
  settings.isovalue = -1000.0 / 3.0;
  settings.haptics.method = DecompositionMethod::kBcc;
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

auto Members(const RawVoxels& raw) {
  return std::tie(raw.size, raw.type, raw.big_endian, raw.offset_bytes);
}

void ExpectSameSettings(const RenderSettings& read, const RenderSettings& written) {
  EXPECT_EQ(read.isovalue, written.isovalue);
  EXPECT_EQ(read.haptics.method, written.haptics.method);
  EXPECT_EQ(read.haptics.free_side, written.haptics.free_side);
  for (const NumberSetting& setting : kNumberSettings) {
    EXPECT_EQ(read.haptics.*setting.member, written.haptics.*setting.member) << setting.key;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    EXPECT_EQ(read.haptics.*setting.member, written.haptics.*setting.member) << setting.key;
  }
  EXPECT_EQ(read.haptics.layers, written.haptics.layers);
  EXPECT_EQ(read.haptics.tool, written.haptics.tool);
}

void ExpectSameSession(const FeltSession& read, const FeltSession& written) {
  EXPECT_EQ(read.volume.source, written.volume.source);
  EXPECT_EQ(read.volume.title, written.volume.title);
  EXPECT_EQ(read.volume.spacing_mm, written.volume.spacing_mm);
  EXPECT_EQ(read.volume.frame, written.volume.frame);
  ASSERT_EQ(read.volume.raw.has_value(), written.volume.raw.has_value());
  EXPECT_TRUE(!read.volume.raw || Members(*read.volume.raw) == Members(*written.volume.raw));
  ExpectSameSettings(read.settings, written.settings);
}

class SessionFileTest : public ::testing::Test {
 protected:
  std::string Text() const { return test::TextOf(path_); }
  SavedSession WriteAndRead(const SavedSession& written) const {
    WriteSessionFile(path_, written);
    const SessionFile read = ReadSessionFile(path_);
    EXPECT_TRUE(read.session) << read.damage;
    return read.session.value_or(SavedSession());
  }
  void Write(const std::string& text) const { std::ofstream(path_, std::ios::binary) << text; }

  test::TemporaryFolder folder_;
  const std::filesystem::path path_ = folder_.path() / "session.toml";
};

TEST_F(SessionFileTest, HoldsAllToTheBit) {
  SavedSession written = Session1();
  written.felt.settings.haptics.layers.layer = {
      {.id = 5, .name = "sk\"in", .isovalue = -300.1, .pop_force_n = 1.0 / 3.0},
      {.id = 1, .name = "bone", .isovalue = 300.0, .pop_out_force_n = 0.0}};
  written.felt.settings.haptics.tool = {
      .name = "dr\"ill",
      .ball = {{Vec3(0.1, 0, 1.0 / 3.0), 3.0, true}, {Vec3(0, -2, 9)}},
      .rotation_length_mm = 25.1};
  SurfaceLayers& configured = written.configured_settings.haptics.layers;
  configured.layer = {{.name = "skin", .isovalue = -300.1}};  // the daemon gives it an id
  const SavedSession read = WriteAndRead(written);
  EXPECT_EQ(read.configured_settings.haptics.layers, configured);
  EXPECT_EQ(read.configured.source, written.configured.source);
  EXPECT_EQ(read.configured.spacing_mm, written.configured.spacing_mm);
  EXPECT_EQ(read.configured.device_mm_per_volume_mm, written.configured.device_mm_per_volume_mm);
  EXPECT_EQ(read.configured.isovalue, written.configured.isovalue);
  EXPECT_EQ(read.configured_settings.haptics.method, DecompositionMethod::kBcc);
  EXPECT_EQ(read.configured_settings.haptics.stiffness_n_per_mm, 0.7);
  EXPECT_EQ(read.attempts, 2);
  ExpectSameSession(read.felt, written.felt);
}

TEST_F(SessionFileTest, WhatIsNotGivenStaysSo) {
  EXPECT_FALSE(ReadSessionFile(path_).session);
  EXPECT_EQ(ReadSessionFile(path_).damage, "");
  SavedSession written;
  written.configured.source = written.felt.volume.source = "builtin:bumps";
  const SavedSession read = WriteAndRead(written);
  EXPECT_FALSE(read.configured.spacing_mm);
  EXPECT_FALSE(read.configured.device_mm_per_volume_mm);
  ExpectSameSession(read.felt, written.felt);
}

// Such a path cannot be loaded again: better none than another one.
TEST_F(SessionFileTest, APathThatIsNoUtf8IsLeftOut) {
  SavedSession written = Session1();
  written.felt.volume.source = "/data/\xff\xfe.nrrd";
  EXPECT_EQ(WriteAndRead(written).felt.volume.source, "");
}

// What other damage does: state_file_fuzz.
TEST_F(SessionFileTest, DamageIsSaid) {
  Write("[volume");
  EXPECT_FALSE(ReadSessionFile(path_).session);
  EXPECT_NE(ReadSessionFile(path_).damage, "");
}

TEST_F(SessionFileTest, ASizeThatNoVolumeHasIsNone) {
  WriteSessionFile(path_, Session1());
  const std::string text = Text(), number = "1000000007";
  for (const char* other : {"1e300", "-1e300", "nan", "inf", "-5", "9223372036854775807"}) {
    std::string changed = text;
    Write(changed.replace(changed.find(number), number.size(), other));
    const SessionFile read = ReadSessionFile(path_);
    ASSERT_TRUE(read.session && read.session->felt.volume.raw) << read.damage;
    EXPECT_EQ(read.session->felt.volume.raw->size, (std::array<std::int64_t, 3>{1, 0, 3})) << other;
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
  {
    const auto keeper = Make();
    keeper->Start();
    data_.session().store().TellEdits([&](std::uint64_t edits) { keeper->NoteEdits(edits); });
    std::mt19937 random(1);
    for (int n = 0; n < 3; ++n) data_.RandomEdit(random);
    data_.session().store().TellEdits({});
  }
  const auto keeper = Make();
  const std::optional<FeltSession> left = keeper->TakeLeft();
  ASSERT_TRUE(left);
  ExpectSameSession(*left, data_.session().Felt());
  EXPECT_EQ(keeper->lost_edits(), 3u);
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
  settings.haptics.method = DecompositionMethod::kBcc;
  settings.haptics.layers.layer = {{.name = "skin", .isovalue = 0.25}};
  const LoadRequest configured{.source = "builtin:bumps", .isovalue = 0.25};
  const std::optional<FeltSession> left = Make(configured, settings)->TakeLeft();
  ASSERT_TRUE(left);
  EXPECT_EQ(left->volume.source, "builtin:sphere:24");
  EXPECT_EQ(left->volume.isovalue, 0.25);
  settings.isovalue = left->settings.isovalue;
  ExpectSameSettings(left->settings, settings);
  // Layers are felt from below alone.
  settings.haptics.free_side = FreeSide::kAbove;
  EXPECT_TRUE(Make(configured, settings)->TakeLeft()->settings.haptics.layers.layer.empty());
}

// Readers of the state alone, or nobody.
TEST_F(SessionKeeperTest, AFolderThatCannotBeReadStopsNothing) {
  Leave();
  std::filesystem::remove_all(path_.parent_path());
  std::filesystem::create_symlink(path_.parent_path(), path_.parent_path());
  EXPECT_FALSE(Make()->TakeLeft());
}

// As often as it ends so: it is not what daemons die of.
TEST_F(SessionKeeperTest, AnEndInOrderLosesNoMoreThanACrash) {
  for (int n = 0; n < 2 * SessionKeeper::kMostAttempts; ++n) {
    const auto keeper = Make();
    EXPECT_EQ(keeper->TakeLeft().has_value(), n > 0);
    EXPECT_EQ(keeper->lost_edits(), n > 0 ? 5u : 0u);
    keeper->Start();
    keeper->NoteEdits(5);
    keeper->End();
    EXPECT_NE(keeper->Await(), "");
  }
  const auto keeper = Make();
  ExpectSameSession(keeper->TakeLeft().value(), data_.session().Felt());
  EXPECT_TRUE(keeper->ended_cleanly());
  keeper->GiveBack();
  const auto again = Make();
  EXPECT_FALSE(again->TakeLeft(/*fresh=*/true));
  EXPECT_TRUE(again->ended_cleanly());
  EXPECT_EQ(again->lost_edits(), 5u);
  EXPECT_FALSE(IsThere());
}

TEST_F(SessionKeeperTest, AnotherConfiguredVolumeLeavesNothing) {
  LoadRequest grid{.source = "builtin:bumps"}, frame = grid, raw = grid;
  grid.grid = "density";
  frame.frame = 1;
  raw.raw.emplace().size = {16, 32, 8};
  for (const LoadRequest& other : {LoadRequest{.source = "builtin:gyroid"}, grid, frame, raw}) {
    Leave();
    EXPECT_FALSE(Make(other)->TakeLeft());
    EXPECT_FALSE(IsThere());
  }
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

TEST_F(SessionKeeperTest, AFullDiskCostsNoSession) {
  Leave();
  signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit full{0, limit.rlim_max};
  setrlimit(RLIMIT_FSIZE, &full);
  const auto left = Make()->TakeLeft();
  setrlimit(RLIMIT_FSIZE, &limit);
  EXPECT_TRUE(left);
  EXPECT_TRUE(IsThere());
}

TEST_F(SessionKeeperTest, ASaveThatFailedIsTriedAgain) {
  std::ofstream(folder_.path() / "sessions") << "no folder";
  const auto keeper = Make();
  keeper->Start();
  std::this_thread::sleep_for(SessionKeeper::kAfterFailure / 2);
  std::filesystem::remove(folder_.path() / "sessions");
  EXPECT_TRUE(test::Eventually([&] { return IsThere(); }));
}

TEST_F(SessionKeeperTest, WhoAwaitsASaveIsToldWhatBecameOfIt) {
  std::ofstream(folder_.path() / "sessions") << "no folder";
  const auto keeper = Make();
  EXPECT_NE(keeper->Await(), "") << "not started";
  keeper->Start();
  const std::string problem = keeper->Await();
  EXPECT_NE(problem.find("sessions"), std::string::npos) << problem;
  EXPECT_EQ(keeper->failure(), problem);
  std::filesystem::remove(folder_.path() / "sessions");
  data_.session().RaiseSettingsRevision(0);
  EXPECT_EQ(keeper->Await(), "");  // at once, whenever the next try was due
  EXPECT_TRUE(ReadSessionFile(path_).session);
  EXPECT_EQ(keeper->failure(), "");
}

TEST(Saver, SaysWhenTheDiskTakesTooLong) {
  std::promise<void> go;
  Saver saver("test", std::chrono::hours(1), [&](bool at_once) {
    if (at_once) go.get_future().wait();
    return std::string();
  });
  const std::string slow = saver.Await();
  EXPECT_NE(slow, "");
  EXPECT_EQ(saver.failure(), slow);
  go.set_value();
  EXPECT_TRUE(test::Eventually([&] { return saver.failure().empty(); }));
}

// A save that had begun may have taken what was there before.
TEST(Saver, AwaitsASaveThatBeginsAfterTheCall) {
  std::atomic<int> value = 0, saved = 0, saves = 0;
  Saver saver("test", std::chrono::hours(1), [&](bool) {
    const int now = value;
    ++saves;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    saved = now;
    return std::string();
  });
  test::OnThreads(4, [&](int) {
    for (int n = 0; n < 20; ++n) {
      const int own = ++value;
      EXPECT_EQ(saver.Await(), "");
      EXPECT_GE(saved, own);
    }
  });
  EXPECT_LT(saves, 60) << "those who wait share saves";
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
