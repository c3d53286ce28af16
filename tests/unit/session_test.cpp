// The session with a running servo loop and pump, without gRPC.
#include "server/session/session.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <memory>
#include <thread>

#include "common/error/error.h"
#include "server/device/path_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_loop.h"
#include "server/session/volume_editor.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

const LoadProgress kQuiet = [](std::string_view, double) {};
const LoadCancelled kNever = [] { return false; };

class SessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    // Through the sphere in the middle of the workspace and back.
    device_ = std::make_unique<SimulatedDevice>(
        std::make_unique<PathScript>(std::vector<Vec3>{Vec3(-70, 2, 1), Vec3(70, 1, 2)}, 100.0));
    outbox_ = std::make_unique<TickOutbox>();
    pump_ = std::make_unique<Pump>(*outbox_);
    session_ = std::make_unique<Session>(device_->spec(), inbox_, *pump_, VolumeLoader{});
    session_->Load({.source = "builtin:sphere:32"}, kQuiet, kNever);
    RealtimeOptions options;
    options.lock_memory = false;
    servo_ = std::make_unique<ServoLoop>(*device_, inbox_, *outbox_, options, SafetyLimits{});
    pump_->Start();
    servo_->Start();
  }
  void TearDown() override {
    servo_->Stop();
    pump_->Stop();
  }

  SceneInbox inbox_;
  std::unique_ptr<SimulatedDevice> device_;
  std::unique_ptr<TickOutbox> outbox_;
  std::unique_ptr<Pump> pump_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<ServoLoop> servo_;
};

TEST_F(SessionTest, AnUpdateIsAppliedAtATick) {
  const SettingsApplied a = session_->Update({.isovalue = 0.4});
  const SettingsApplied b = session_->Update({.normalized_isovalue = 0.6});
  EXPECT_EQ(a.state.settings.isovalue, 0.4);
  EXPECT_NEAR(b.state.settings.normalized_isovalue, 0.6, 1e-12);
  EXPECT_EQ(b.state.settings_revision, a.state.settings_revision + 1);
  EXPECT_GT(b.applied.tick, a.applied.tick);
}

TEST_F(SessionTest, BadUpdatesChangeNothing) {
  const SettingsState before = session_->settings();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const SettingsUpdate& bad :
       {SettingsUpdate{.isovalue = 1.5}, SettingsUpdate{.isovalue = nan},
        SettingsUpdate{.normalized_isovalue = -0.1},
        SettingsUpdate{.isovalue = 0.5, .normalized_isovalue = 0.5},
        SettingsUpdate{.isovalue = 0.6, .numbers = {{&HapticSettings::pop_force_n, 100.0}}},
        SettingsUpdate{.numbers = {{&HapticSettings::damping_n_s_per_m, 1.0},
                                   {&HapticSettings::magnet_range_mm, nan}},
        .flags = {{&HapticSettings::force_shading, true}},
        .free_side = FreeSide::kAbove}}) {
    EXPECT_EQ(Refusal([&] { session_->Update(bad); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([&] { session_->Update({.isovalue = 0.5, .expected_revision = 99}); }),
            ErrorKind::kConflict);
  EXPECT_EQ(session_->settings().settings_revision, before.settings_revision);
  EXPECT_EQ(session_->settings().settings.isovalue, before.settings.isovalue);
  EXPECT_EQ(session_->settings().settings.haptics.damping_n_s_per_m, 0.0);
  EXPECT_FALSE(session_->settings().settings.haptics.force_shading);
  EXPECT_EQ(session_->settings().settings.haptics.free_side, FreeSide::kBelow);
}

TEST_F(SessionTest, EveryNumberHasARangeThatNamesItsKeyAndUnit) {
  for (const NumberSetting& setting : kNumberSettings) {
    SCOPED_TRACE(setting.key);
    for (const double good : {setting.low, setting.high}) {
      const SettingsApplied applied = session_->Update({.numbers = {{setting.member, good}}});
      EXPECT_EQ(applied.state.settings.haptics.*setting.member, good);
    }
    for (const double bad : {std::nextafter(setting.high, HUGE_VAL), -HUGE_VAL, HUGE_VAL,
                             std::nextafter(setting.low, -HUGE_VAL), std::nan("")}) {
      try {
        session_->Update({.numbers = {{setting.member, bad}}});
        ADD_FAILURE() << bad << " was accepted";
      } catch (const Error& error) {
        const std::string_view text = error.what();
        EXPECT_TRUE(text.starts_with(setting.key)) << text;
        EXPECT_TRUE(text.ends_with(setting.unit)) << text;
      }
    }
    EXPECT_EQ(session_->settings().settings.haptics.*setting.member, setting.high);
  }
}

TEST_F(SessionTest, AStaticFrictionBelowTheDynamicOneIsAllowed) {
  const SettingsApplied applied =
      session_->Update({.numbers = {{&HapticSettings::static_friction, 0.1},
                                    {&HapticSettings::dynamic_friction, 0.5}}});
  EXPECT_EQ(applied.state.settings.haptics.static_friction, 0.1);
  EXPECT_EQ(applied.state.settings.haptics.dynamic_friction, 0.5);
}

TEST_F(SessionTest, FlagsAndTheFreeSideComeAndGo) {
  for (const bool on : {true, false}) {
    SettingsUpdate update{.free_side = on ? FreeSide::kAbove : FreeSide::kBelow};
    for (const FlagSetting& setting : kFlagSettings) update.flags.emplace_back(setting.member, on);
    const HapticSettings haptics = session_->Update(update).state.settings.haptics;
    for (const FlagSetting& setting : kFlagSettings) {
      EXPECT_EQ(haptics.*setting.member, on) << setting.key;
    }
    EXPECT_EQ(haptics.free_side, *update.free_side);
  }
}

TEST_F(SessionTest, BadSettingsToStartWithAreRefused) {
  EXPECT_EQ(Refusal([&] { session_->SetInitial({.haptics = {.magnet_force_n = 1.6}}); }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(session_->settings().settings.haptics.magnet_force_n, 0.0);
}

TEST_F(SessionTest, AFailedLoadKeepsTheVolume) {
  const VolumeState before = session_->volume();
  AppliedTick applied;
  for (const LoadRequest& bad :
       {LoadRequest{.source = "builtin:cube"}, LoadRequest{.source = "relative.nrrd"},
        LoadRequest{.source = "builtin:bumps:16", .isovalue = 7.0},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = -1.0},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = 1e-300},
        LoadRequest{.source = "builtin:bumps:16", .device_mm_per_volume_mm = 1e300},
        LoadRequest{.source = "builtin:bumps:16", .spacing_mm = Vec3(0, 1, 1)}}) {
    EXPECT_EQ(Refusal([&] { session_->LoadAndWait(bad, kQuiet, kNever, applied); }),
              ErrorKind::kInvalidArgument)
        << bad.source;
  }
  EXPECT_EQ(session_->volume().volume, before.volume);
  EXPECT_EQ(session_->volume().settings_revision, before.settings_revision);
}

TEST_F(SessionTest, ACancelledLoadKeepsTheVolume) {
  const VolumeState before = session_->volume();
  AppliedTick applied;
  int asked = 0;
  EXPECT_EQ(Refusal([&] {
              session_->LoadAndWait(
                  {.source = "builtin:bumps:32"}, kQuiet, [&] { return ++asked > 33; }, applied);
            }),
            ErrorKind::kCancelled);
  EXPECT_EQ(session_->volume().volume, before.volume);
}

TEST_F(SessionTest, TheVolumeFeltBeforeIsFreedByALoad) {
  const std::weak_ptr<const VolumeSnapshot> before = session_->volume().volume;
  AppliedTick applied;
  session_->LoadAndWait({.source = "builtin:gyroid:32"}, kQuiet, kNever, applied);
  session_->retired().WaitForFreed(std::chrono::seconds(10));
  EXPECT_TRUE(before.expired());
}

TEST_F(SessionTest, ALoadKeepsTheNormalisedIsovalueAndIsSeenAtOneTick) {
  session_->Update({.normalized_isovalue = 0.3});
  AppliedTick applied;
  const VolumeState state =
      session_->LoadAndWait({.source = "builtin:gyroid:32"}, kQuiet, kNever, applied);
  EXPECT_EQ(state.volume->revision(), 2u);
  EXPECT_NEAR(session_->settings().settings.normalized_isovalue, 0.3, 1e-12);
  EXPECT_GT(applied.tick, 0u);
}

TEST_F(SessionTest, MethodsForComparisonAreRefusedOnHardware) {
  EXPECT_EQ(session_->Update({.method = DecompositionMethod::kTptd}).state.settings.method,
            DecompositionMethod::kTptd);
  DeviceSpec hardware = device_->spec();
  hardware.verification_level = VerificationLevel::kForceVerified;
  SceneInbox inbox;
  Session session(hardware, inbox, *pump_, VolumeLoader{});
  session.Load({.source = "builtin:sphere:16"}, kQuiet, kNever);
  for (DecompositionMethod method :
       {DecompositionMethod::kTptd, DecompositionMethod::kTpbccPublished}) {
    EXPECT_EQ(Refusal([&] { session.Update({.method = method}); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(Refusal([&] { session.SetInitial({.method = method}); }),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(session.settings().settings.method, DecompositionMethod::kTpbcc);
}

// Collects samples on the pump thread and checks that none mixes revisions.
class Checker : public SampleSink {
 public:
  void OnSample(const TickSample& sample) override {
    ++samples_;
    contacts_ += sample.contact;
    // The test sets the isovalue to 0.3 + revision mod 5 / 10.
    const double expected = 0.3 + static_cast<double>(sample.settings_revision % 5) / 10.0;
    // Under a stylus that touches, the isovalue moves there.
    const double left = std::abs(sample.isovalue - expected);
    const bool nearer = left == 0.0 || left < std::abs(last_isovalue_ - expected);
    if (sample.settings_revision > 1) mixed_ += !nearer;
    last_isovalue_ = sample.isovalue;
    above_ += sample.density > sample.isovalue && sample.mode != TickMode::kEjecting;
    went_back_ += sample.settings_revision < last_revision_;
    last_revision_ = sample.settings_revision;
  }
  int samples_ = 0, contacts_ = 0, mixed_ = 0, above_ = 0, went_back_ = 0;
  std::uint64_t last_revision_ = 0;
  double last_isovalue_ = 0.0;
};

TEST_F(SessionTest, NoTickMixesRevisionsUnderAStreamOfUpdates) {
  const auto checker = std::make_shared<Checker>();
  pump_->Subscribe(checker);
  for (int n = 0; n < 1000; ++n) {
    const std::uint64_t next = session_->settings().settings_revision + 1;
    session_->Update({.isovalue = 0.3 + static_cast<double>(next % 5) / 10.0});
  }
  servo_->Stop();
  pump_->Stop();
  EXPECT_GT(checker->samples_, 1000);
  EXPECT_GT(checker->contacts_, 50);
  EXPECT_EQ(checker->mixed_, 0);
  EXPECT_EQ(checker->above_, 0);
  EXPECT_EQ(checker->went_back_, 0);
}

// Samples that nobody carries say nothing about the loop.
TEST_F(SessionTest, AnUpdateIsAppliedWhileThePumpStandsStill) {
  const SettingsApplied before = session_->Update({.isovalue = 0.4});
  pump_->Stop();
  SettingsApplied last = before;
  for (const double isovalue : {0.5, 0.6, 0.7}) {
    const SettingsApplied applied = session_->Update({.isovalue = isovalue});
    EXPECT_EQ(applied.state.settings.isovalue, isovalue);
    EXPECT_GT(applied.applied.tick, last.applied.tick);
    EXPECT_GT(applied.applied.time_ns, last.applied.time_ns);
    last = applied;
  }
  servo_->Stop();
  EXPECT_EQ(Refusal([&] { session_->Update({.isovalue = 0.5}); }), ErrorKind::kUnavailable);
}

// Whether it stopped just now or long ago.
TEST_F(SessionTest, AnUpdateWithoutAServoChangesNothing) {
  const SettingsState before = session_->Update({.isovalue = 0.4}).state;
  servo_->Stop();
  const SettingsUpdate update{.isovalue = 0.5,
                              .numbers = {{&HapticSettings::damping_n_s_per_m, 1.0}},
                              .method = DecompositionMethod::kBcc};
  for (int n = 0; n < 2; ++n) {
    EXPECT_EQ(Refusal([&] { session_->Update(update); }), ErrorKind::kUnavailable);
    const RenderSettings after = session_->settings().settings;
    EXPECT_EQ(after.isovalue, before.settings.isovalue);
    EXPECT_EQ(after.normalized_isovalue, before.settings.normalized_isovalue);
    EXPECT_EQ(after.method, before.settings.method);
    EXPECT_EQ(after.haptics.damping_n_s_per_m, before.settings.haptics.damping_n_s_per_m);
  }
}

class Scenes final : public SceneListener {
 public:
  explicit Scenes(Session& session) : listening_(session, *this) {}
  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override {
    if (!changes.empty()) edited[scene.scene_revision] = scene.volume->revision();
    ++count;
  }

  std::map<std::uint64_t, std::uint64_t> edited;  // volume revision, by scene revision
  int count = 0;

 private:
  const Listening listening_;
};

TEST_F(SessionTest, AListenerThatIsGoneHearsNothing) {
  auto first = std::make_unique<Scenes>(*session_);
  const Scenes second(*session_);
  session_->SetForcesOff(true);
  EXPECT_EQ(first->count, 1);
  first.reset();
  session_->SetForcesOff(false);
  EXPECT_EQ(second.count, 2);
}

// Not that of a scene that somebody else published a moment later.
TEST_F(SessionTest, AnEditNamesItsOwnScene) {
  VolumeEditor editor(*session_);
  const Scenes scenes(*session_);
  std::atomic<bool> stop = false;
  std::thread others([&] {
    while (!stop) session_->SetForcesOff(true);
  });
  for (int n = 0; n < 300; ++n) {
    const EditOutcome outcome = editor.Edit(
        {.shape = BoxShape{Vec3(4, 4, 4), Vec3(27, 27, 27)}, .value = n % 2 == 0 ? 0.25 : 0.75});
    const auto scene = scenes.edited.find(outcome.scene_revision);
    ASSERT_NE(scene, scenes.edited.end()) << n;
    ASSERT_EQ(scene->second, outcome.volume_revision);
  }
  stop = true;
  others.join();
}

TEST(Registration, FitsTheVolumeIntoTheWorkspace) {
  VolumeMetadata metadata;
  metadata.size = Vec3i(301, 324, 56);
  metadata.spacing_mm = Vec3(1, 1, 1.4);
  metadata.origin_W_mm = Vec3(-10, 500, 3);
  // Mirrored and turned.
  metadata.direction << 0, 1, 0, -1, 0, 0, 0, 0, -1;
  const DeviceSpec device = SimulatedDeviceSpec();
  const Registration fit = FitToWorkspace(metadata, device, std::nullopt);
  const AffineMap X_DI = fit.X_DW * metadata.WorldFromIndex();
  const Vec3 middle = X_DI.Apply(Vec3(150, 161.5, 27.5));
  EXPECT_NEAR(middle.norm(), 0.0, 1e-9);
  Vec3 extent = Vec3::Zero();
  for (int c = 0; c < 8; ++c) {
    extent = extent.cwiseMax(
        X_DI.Apply(Vec3(c & 1 ? 300 : 0, c & 2 ? 323 : 0, c & 4 ? 55 : 0)).cwiseAbs());
  }
  EXPECT_NEAR((extent.array() / Eigen::Array3d(80, 60, 35)).maxCoeff(), kWorkspaceFill, 1e-9);
  EXPECT_EQ(FitToWorkspace(metadata, device, 0.25).device_mm_per_volume_mm, 0.25);
  EXPECT_THROW(FitToWorkspace(metadata, device, 0.0), Error);
}

}  // namespace
}  // namespace palpate
