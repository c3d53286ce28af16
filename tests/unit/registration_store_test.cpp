// Registrations that outlive a volume and a daemon; damaged and hostile files.
#include "server/kept/registration_store.h"

#include <gtest/gtest.h>

#include <fstream>

#include "common/error/error.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;

VolumeMetadata VolumeOf(const std::string& source) {
  VolumeMetadata metadata;
  metadata.size = Vec3i(31, 42, 6);
  metadata.spacing_mm = Vec3(0.1 / 3.0, 1.0, 2.5);
  metadata.origin_W_mm = Vec3(-210, 500, 3);
  metadata.source = source;
  return metadata;
}

VolumePlace At(const VolumeMetadata& volume, double x_mm) {
  return MakeVolumePlace(volume, Vec3(x_mm, 1.0 / 3.0, -1e-7),
                         Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized())),
                         2.0 / 3.0);
}

void ExpectSamePlace(const std::optional<VolumePlace>& found, const VolumePlace& kept) {
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->p_DCenter_mm, kept.p_DCenter_mm);
  EXPECT_EQ(found->R_DW.coeffs(), kept.R_DW.coeffs());
  EXPECT_EQ(found->device_mm_per_volume_mm, kept.device_mm_per_volume_mm);
  EXPECT_EQ(found->X_DW.translation, kept.X_DW.translation);
}

class RegistrationStoreTest : public ::testing::Test {
 protected:
  void Write(const std::string& text) const {
    std::filesystem::create_directories(state_);
    std::ofstream(path_, std::ios::binary) << text;
  }
  std::size_t Entries() const { return ReadRegistrations(path_).entries.size(); }

  test::TemporaryFolder folder_;
  const std::filesystem::path state_ = folder_.path() / "not" / "yet" / "there";
  const std::filesystem::path path_ = state_ / "registrations.toml";
  const std::filesystem::path damaged_ = state_ / "registrations.toml.damaged";
};

TEST_F(RegistrationStoreTest, IsThereAgainToTheLastBit) {
  const VolumeMetadata head = VolumeOf("/data/head.nrrd"), bumps = VolumeOf("builtin:bumps");
  {
    RegistrationStore store(state_);
    EXPECT_FALSE(store.Find(head).has_value());
    store.Keep(head, At(head, 1.0));
    store.Keep(bumps, At(bumps, 2.0));
    store.Keep(head, At(head, 0.1));
    ExpectSamePlace(store.Find(head), At(head, 0.1));
    EXPECT_FALSE(std::filesystem::exists(path_)) << "written at once";
  }
  RegistrationStore store(state_);
  ExpectSamePlace(store.Find(head), At(head, 0.1));
  ExpectSamePlace(store.Find(bumps), At(bumps, 2.0));
  EXPECT_EQ(Entries(), 2u);
  EXPECT_FALSE(std::filesystem::exists(path_.string() + ".partial"));
}

TEST_F(RegistrationStoreTest, NothingIsWrittenWithoutAFolderOrAChange) {
  const VolumeMetadata volume = VolumeOf("builtin:bumps");
  {
    RegistrationStore store("");
    store.Keep(volume, At(volume, 1.0));
    ExpectSamePlace(store.Find(volume), At(volume, 1.0));
    store.Save();
    RegistrationStore unchanged(state_);
  }
  EXPECT_FALSE(std::filesystem::exists(state_));
}

TEST_F(RegistrationStoreTest, AnotherSizeOrSpacingIsAnotherVolume) {
  RegistrationStore store("");
  const VolumeMetadata volume = VolumeOf("/data/head.nrrd");
  store.Keep(volume, At(volume, 1.0));
  VolumeMetadata other = volume;
  other.size.z() = 7;
  EXPECT_FALSE(store.Find(other).has_value());
  EXPECT_NE(store.WhyLost(other).find(std::to_string(volume.size.z()) + " voxels"),
            std::string::npos);
  EXPECT_EQ(store.WhyLost(volume), "");
  other = volume;
  other.spacing_mm.x() = std::nextafter(other.spacing_mm.x(), 1.0);
  EXPECT_FALSE(store.Find(other).has_value());
  other = volume;
  other.source = "/data/../data/./head.nrrd";
  EXPECT_TRUE(store.Find(other).has_value());
}

TEST_F(RegistrationStoreTest, IsWrittenAMomentAfterTheFirstChange) {
  RegistrationStore store(state_, 20ms);
  const VolumeMetadata volume = VolumeOf("builtin:bumps");
  for (int n = 0; n < 100; ++n) store.Keep(volume, At(volume, n));
  EXPECT_TRUE(test::Eventually([&] {
    const auto found = RegistrationStore(state_).Find(volume);
    return found && found->p_DCenter_mm.x() == 99.0;
  }));
  EXPECT_EQ(Entries(), 1u);
}

TEST_F(RegistrationStoreTest, TheOldestIsForgotten) {
  const std::size_t most = RegistrationStore::kMostEntries;
  RegistrationStore store(state_);
  for (std::size_t n = 0; n < most; ++n) {
    const VolumeMetadata volume = VolumeOf("/data/" + std::to_string(n));
    store.Keep(volume, At(volume, 1.0));
  }
  store.Keep(VolumeOf("/data/0"), At(VolumeOf("/data/0"), 2.0));  // the newest now
  store.Keep(VolumeOf("/data/new"), At(VolumeOf("/data/new"), 3.0));
  store.Save();
  EXPECT_TRUE(store.Find(VolumeOf("/data/0")).has_value());
  EXPECT_FALSE(store.Find(VolumeOf("/data/1")).has_value());
  EXPECT_TRUE(store.Find(VolumeOf("/data/2")).has_value());
  EXPECT_EQ(Entries(), most);
}

TEST_F(RegistrationStoreTest, AnotherDaemonsEntriesStay) {
  RegistrationStore a(state_), b(state_);
  const VolumeMetadata first = VolumeOf("builtin:bumps"), second = VolumeOf("builtin:gyroid");
  a.Keep(first, At(first, 1.0));
  a.Save();
  b.Keep(second, At(second, 2.0));
  b.Save();
  RegistrationStore c(state_);
  EXPECT_TRUE(c.Find(first).has_value());
  EXPECT_TRUE(c.Find(second).has_value());
}

TEST_F(RegistrationStoreTest, ManyDaemonsWriteAtOnce) {
  test::OnThreads(4, [&](int d) {
    RegistrationStore store(state_, 1h);
    for (int n = 0; n < 25; ++n) {
      const VolumeMetadata volume = VolumeOf(std::to_string(d) + " " + std::to_string(n));
      store.Keep(volume, At(volume, n));
      store.Save();
    }
  });
  EXPECT_EQ(Entries(), 100u);
  EXPECT_FALSE(std::filesystem::exists(damaged_));
}

TEST_F(RegistrationStoreTest, NamesOfAnyKindAreKeptOrLeftOut) {
  const std::vector<std::string> names = {
      "/data/größe 1 \"x\".nrrd", "/data/'''\\\n\t#]", "upload:head.nii.gz", "/data/\x7f\x01", "",
      std::string(100'000, 'a')};
  const std::string not_utf8 = "/data/\xff\xfe.nrrd", split = "/data/\xc3";
  {
    RegistrationStore store(state_);
    for (const std::string& name : names) store.Keep(VolumeOf(name), At(VolumeOf(name), 1.0));
    for (const std::string& name : {not_utf8, split}) {
      store.Keep(VolumeOf(name), At(VolumeOf(name), 1.0));
      EXPECT_TRUE(store.Find(VolumeOf(name)).has_value());
    }
  }
  RegistrationStore store(state_);
  EXPECT_FALSE(std::filesystem::exists(damaged_)) << test::TextOf(path_);
  EXPECT_EQ(Entries(), names.size());
  for (const std::string& name : names) {
    EXPECT_TRUE(store.Find(VolumeOf(name)).has_value()) << name.substr(0, 30);
  }
  EXPECT_FALSE(store.Find(VolumeOf(not_utf8)).has_value());
}

// The entry of VolumeOf("builtin:bumps"), with one line changed.
std::string Entry(const std::string& part = "", const std::string& instead = "") {
  std::string text =
      "[[registration]]\nsource = 'builtin:bumps'\nsize = [31, 42, 6]\n"
      "spacing_mm = [0.03333333333333333, 1, 2.5]\ncenter_mm = [1, 2, 3]\n"
      "rotation_wxyz = [1, 0, 0, 0]\ndevice_mm_per_volume_mm = 1\n";
  return text.replace(text.find(part), part.size(), instead);
}

TEST_F(RegistrationStoreTest, ADamagedFileIsSetAsideAndStopsNothing) {
  const VolumeMetadata volume = VolumeOf("builtin:bumps");
  Write(Entry());
  {
    RegistrationStore store(state_);
    ASSERT_TRUE(store.Find(volume).has_value());
    EXPECT_EQ(store.Find(volume)->p_DCenter_mm, Vec3(1, 2, 3));
    EXPECT_FALSE(std::filesystem::exists(damaged_));
  }
  for (const std::string& text :
       {std::string("no toml"), std::string("\0\0\0\0", 4), Entry().substr(0, 80),
        std::string("[registration]\n"), std::string("registration = 3\n"),
        std::string("registration = [1, 2]\n"), std::string("other = 1\n"),
        "x = " + std::string(100'000, '['), std::string((16 << 20) + 1, '#'),
        std::string("x = '\xff'\n"), Entry("[31, 42, 6]", "[31, 42]"),
        Entry("[1, 2, 3]", "['1', 2, 3]"), Entry("'builtin:bumps'", "7"),
        Entry("= 1\n", "= true\n"), Entry("rotation_wxyz = [1, 0, 0, 0]\n")}) {
    std::filesystem::remove(damaged_);
    Write(text);
    RegistrationStore store(state_);
    EXPECT_TRUE(std::filesystem::exists(damaged_)) << text.substr(0, 60);
    EXPECT_FALSE(std::filesystem::exists(path_));
    EXPECT_FALSE(store.Find(volume).has_value());
    store.Keep(volume, At(volume, 5.0));
    store.Save();
    EXPECT_EQ(Entries(), 1u);
  }
  // Good entries beside a bad one are kept.
  std::filesystem::remove(damaged_);
  Write(Entry() + "\n[[registration]]\nsource = 'c'\n");
  RegistrationStore store(state_);
  EXPECT_TRUE(std::filesystem::exists(damaged_));
  EXPECT_TRUE(store.Find(volume).has_value());
}

TEST_F(RegistrationStoreTest, EntriesThatAreNoRegistrationAreNotUsed) {
  for (const std::string& bad :
       {Entry("[1, 2, 3]", "[nan, 0, 0]"), Entry("[1, 2, 3]", "[0, 0, 1e9]"),
        Entry("[1, 0, 0, 0]", "[0, 0, 0, 0]"), Entry("_mm = 1\n", "_mm = inf\n"),
        Entry("_mm = 1\n", "_mm = 0\n"), Entry("_mm = 1\n", "_mm = -1\n"),
        Entry("[31, 42, 6]", "[1e30, nan, -1]"), Entry("[0.03333333333333333,", "[nan,")}) {
    Write(bad);
    RegistrationStore store(state_);
    EXPECT_FALSE(store.Find(VolumeOf("builtin:bumps")).has_value()) << bad;
  }
}

TEST_F(RegistrationStoreTest, AFolderThatCannotBeWrittenStopsNothing) {
  std::ofstream(folder_.path() / "file") << "no folder";
  const VolumeMetadata volume = VolumeOf("builtin:bumps");
  RegistrationStore store(folder_.path() / "file" / "state", 1ms);
  store.Keep(volume, At(volume, 1.0));
  store.Save();
  ExpectSamePlace(store.Find(volume), At(volume, 1.0));
  // What is in the way of the file is set aside, a folder too.
  std::filesystem::create_directories(path_);
  RegistrationStore beside(state_);
  beside.Keep(volume, At(volume, 1.0));
  beside.Save();
  EXPECT_EQ(Entries(), 1u);
  EXPECT_TRUE(std::filesystem::is_directory(damaged_));
}

TEST_F(RegistrationStoreTest, AFailedSaveIsMadeUpFor) {
  std::ofstream(folder_.path() / "not") << "in the way";
  const VolumeMetadata volume = VolumeOf("builtin:bumps"), other = VolumeOf("builtin:gyroid");
  RegistrationStore store(state_, 1h);
  testing::EditableSession data;
  data.session().SetRegistrationStore(store);
  data.Load("builtin:sphere:16");
  const VolumeMetadata felt = data.session().volume().volume->metadata();
  store.Keep(felt, At(felt, 1.0));
  EXPECT_EQ(data.session().volume().place_problem, "");
  store.Save();
  EXPECT_NE(data.session().volume().place_problem, "");
  EXPECT_EQ(store.Failure(volume), "");  // nobody placed it
  store.Keep(volume, At(volume, 1.0));
  std::filesystem::remove(folder_.path() / "not");
  store.Keep(other, At(other, 1.0));
  store.Save();
  EXPECT_EQ(Entries(), 3u);
  EXPECT_EQ(data.session().volume().place_problem, "");
}

TEST_F(RegistrationStoreTest, AFailedSaveIsTriedAgainByItself) {
  std::ofstream(folder_.path() / "not") << "in the way";
  const VolumeMetadata volume = VolumeOf("builtin:bumps");
  RegistrationStore store(state_, 1ms);
  store.Keep(volume, At(volume, 1.0));
  ASSERT_TRUE(test::Eventually([&] { return !store.Failure(volume).empty(); }));
  std::filesystem::remove(folder_.path() / "not");
  EXPECT_TRUE(test::Eventually([&] { return store.Failure(volume).empty(); }));
  EXPECT_EQ(Entries(), 1u);
}

TEST_F(RegistrationStoreTest, ASessionUsesIt) {
  const Vec3 center_mm(7, 8, 9);
  for (const bool restarted : {false, true}) {
    RegistrationStore store(state_);
    testing::EditableSession data;
    Session& session = data.session();
    session.SetRegistrationStore(store);
    const auto load = [&](const LoadRequest& request) {
      return session.Load(request, testing::kQuiet, testing::kNever).registration;
    };
    const auto move = [&](const UpdateRegistrationRequest& update) {
      session.Move([&](const VolumeState& state) {
        return Apply(update, state.volume->metadata(), data.device(), state.registration);
      });
    };
    const LoadRequest bumps{.source = "builtin:bumps:16"};
    const VolumePlace first = load(bumps);
    EXPECT_EQ(first.p_DCenter_mm, restarted ? center_mm : Vec3::Zero());
    move({.center_mm = center_mm});
    // A move that is refused is not kept.
    EXPECT_THROW(move({.scale_by = 0.0}), Error);
    EXPECT_EQ(load({.source = "builtin:gyroid:16"}).p_DCenter_mm, Vec3::Zero());
    const VolumePlace again = load(bumps);
    EXPECT_EQ(again.p_DCenter_mm, center_mm);
    EXPECT_EQ(again.device_mm_per_volume_mm, first.device_mm_per_volume_mm);
    // The scale that is asked for wins; the rest stays.
    LoadRequest scaled = bumps;
    scaled.device_mm_per_volume_mm = 0.5;
    EXPECT_EQ(load(scaled).device_mm_per_volume_mm, 0.5);
    EXPECT_EQ(load(bumps).p_DCenter_mm, center_mm);
    EXPECT_EQ(load(bumps).device_mm_per_volume_mm, 0.5);
    // A scale that makes no volume changes nothing.
    scaled.device_mm_per_volume_mm = -1.0;
    EXPECT_THROW(load(scaled), Error);
    EXPECT_EQ(session.volume().registration.device_mm_per_volume_mm, 0.5);
  }
}

TEST_F(RegistrationStoreTest, APlaceThatDoesNotFitIsToldAsLost) {
  RegistrationStore store(state_);
  testing::EditableSession data;
  Session& session = data.session();
  session.SetRegistrationStore(store);
  for (const int slices : {16, 8}) {
    VolumeMetadata metadata;
    metadata.size = {20, 18, slices};
    metadata.source = "/scan";
    const VolumeState state = session.PublishVolume(
        {.source = "/scan", .device_mm_per_volume_mm = 0.5}, metadata,
        testing::MakeBricks(metadata.size, [](int i, int, int) { return i; }));
    const auto& warnings = state.volume->metadata().warnings;
    ASSERT_EQ(warnings.size(), slices == 8 ? 1u : 0u);
    if (slices == 8) {
      EXPECT_NE(warnings[0].find("20 x 18 x 16"), std::string::npos);
    }
  }
}

// A volume that states no orientation, loaded from `source`.
VolumeState LoadUnoriented(Session& session, const std::string& source, float value = 0.5f,
                           double spacing_mm = 1.0) {
  VolumeMetadata metadata;
  metadata.size = {20, 18, 16};
  metadata.spacing_mm = Vec3::Constant(spacing_mm);
  metadata.source = source;
  return session.PublishVolume(
      {.source = source}, metadata,
      testing::MakeBricks(metadata.size, [&](int i, int, int) { return i < 9 ? value : 0.0f; }));
}

TEST_F(RegistrationStoreTest, AnAnswerIsKeptForTheVoxelsWhateverTheirName) {
  for (const bool restarted : {false, true}) {
    RegistrationStore store(state_);
    testing::EditableSession data;
    Session& session = data.session();
    session.SetRegistrationStore(store);
    const VolumeState first = LoadUnoriented(session, "/data/head.nrrd");
    EXPECT_EQ(first.patient_axes, restarted ? "RAS" : "");
    EXPECT_EQ(first.patient_axes_answered(), restarted);
    const auto stay = [](const VolumeState& state) { return state.registration; };
    EXPECT_THROW(session.Move(stay, {}, PatientFacing{"+y", "-y"}), Error);
    EXPECT_EQ(session.volume().patient_axes, first.patient_axes);
    session.Move(stay, {}, PatientFacing{"+y", "+z"});
    EXPECT_EQ(session.volume().patient_axes, "RAS");
    // Moved, renamed, with another spacing: the same voxels. Not: other voxels of the same name.
    session.Move(stay);
    EXPECT_EQ(session.volume().patient_axes, "RAS");
    EXPECT_EQ(LoadUnoriented(session, "/elsewhere/x.nii", 0.5f, 0.7).patient_axes, "RAS");
    EXPECT_EQ(LoadUnoriented(session, "/data/head.nrrd", 0.25f).patient_axes, "");
  }
}

TEST_F(RegistrationStoreTest, AnAnswerAloneMovesNothing) {
  RegistrationStore store(state_);
  testing::EditableSession data;
  data.session().SetRegistrationStore(store);
  LoadUnoriented(data.session(), "/data/head.nrrd");
  data.inbox().ReaderRestarts();
  const auto geometry = [&] { return data.inbox().Acquire()->surface.geometry_revision; };
  const auto before = geometry();
  data.session().Move([](const VolumeState& state) { return state.registration; }, {},
                      PatientFacing{"+y", "+z"});
  EXPECT_EQ(geometry(), before);
  EXPECT_FALSE(store.Find(data.volume()->metadata()).has_value());
}

TEST_F(RegistrationStoreTest, AStatedOrientationTakesNoAnswer) {
  testing::EditableSession data;
  VolumeMetadata metadata;
  metadata.size = {8, 8, 8};
  metadata.patient_axes = "LPS";
  data.session().PublishVolume({.source = "x"}, metadata,
                               testing::MakeBricks(metadata.size, [](int i, int, int) {
                                 return static_cast<float>(i) / 8.0f;
                               }));
  const auto stay = [](const VolumeState& state) { return state.registration; };
  EXPECT_EQ(testing::Refusal([&] {
              data.session().Move(stay, {}, PatientFacing{"+y", "+z"});
            }),
            ErrorKind::kFailedPrecondition);
  EXPECT_EQ(data.session().volume().patient_axes, "LPS");
  EXPECT_FALSE(data.session().volume().patient_axes_answered());
}

TEST_F(RegistrationStoreTest, ManyThreadsMayKeepAndFind) {
  RegistrationStore store(state_, 1ms);
  test::OnThreads(4, [&](int t) {
    const VolumeMetadata volume = VolumeOf("/data/" + std::to_string(t));
    for (int n = 0; n < 200; ++n) {
      store.Keep(volume, At(volume, n));
      const auto found = store.Find(volume);
      EXPECT_TRUE(found && found->p_DCenter_mm.x() == n);
      if (n % 50 == 0) store.Save();
    }
  });
  store.Save();
  EXPECT_EQ(Entries(), 4u);
}

}  // namespace
}  // namespace palpate
