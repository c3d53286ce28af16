// Carving and the clutch in closed loop with a simulated hand, tick by tick.
#include "server/session/tools.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>

#include "server/servo/servo_loop.h"
#include "tests/support/stylus_rig.h"

namespace palpate {
namespace {

using testing::Force;
using testing::HandAt;
using testing::StylusRig;
using testing::ToVec3;

// What Safety lets the force change by per tick.
constexpr double kSlewN = 0.2 + 1e-9;

const HapticSettings kCarving = {
    .carve_radius_mm = 5.0, .carve_rate_per_s = 2.0, .carve_tool = true};
const HapticSettings kClutching = {.clutch_tool = true};

// Rests on the sphere (radius 25 mm in the workspace) along +z, from 0.5 s with the
// buttons pressed until `until_s`.
HandAt Resting(std::uint32_t buttons, double until_s, const Vec3& target_mm = Vec3(1, 2, 17)) {
  return [=](double time_s) {
    StylusScript::Target target;
    // From above the surface, in half a second.
    target.p_DTarget_mm = target_mm + Vec3(0, 0, 15.0 * std::max(0.0, 1.0 - 2.0 * time_s));
    target.buttons = time_s > 1.0 && time_s <= until_s ? buttons : 0;
    return target;
  };
}

double GreatestJump(const std::vector<TickSample>& samples) {
  double jump_n = 0.0;
  for (std::size_t n = 1; n < samples.size(); ++n) {
    jump_n = std::max(jump_n, (Force(samples[n]) - Force(samples[n - 1])).norm());
  }
  return jump_n;
}

// Ticks in which the proxy is in what is felt as material.
long TicksInside(const std::vector<TickSample>& samples) {
  return std::count_if(samples.begin(), samples.end(), [](const TickSample& s) {
    const bool judged = s.mode == TickMode::kFree || s.mode == TickMode::kConstrained;
    const double sign = s.free_side == FreeSide::kBelow ? 1.0 : -1.0;
    return judged && sign * s.density > sign * s.isovalue + 1e-9;
  });
}

long Ticks(const std::vector<TickSample>& samples, TickMode mode) {
  return std::count_if(samples.begin(), samples.end(),
                       [&](const TickSample& s) { return s.mode == mode; });
}

TEST(Carve, LowersTheSurfaceUnderTheProxySmoothly) {
  StylusRig rig("builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0));
  const std::vector<TickSample> before = rig.Run(1.0);
  ASSERT_TRUE(before.back().contact);
  const std::uint64_t revision = rig.session.volume().volume->revision();
  const std::vector<TickSample> carved = rig.Run(2.0);
  const double depth_mm = before.back().scp_h_mm[2] - carved.back().scp_h_mm[2];
  const double jump_n = GreatestJump(carved);
  std::printf(
      "[ figures  ] carved %.2f mm deep in 2 s, force %.2f to %.2f N, by at most %.4f N "
      "per tick, %ld ticks of ejection\n",
      depth_mm, Force(before.back()).norm(), Force(carved.back()).norm(), jump_n,
      Ticks(carved, TickMode::kEjecting));
  EXPECT_GT(depth_mm, 1.0);
  EXPECT_EQ(TicksInside(carved), 0);
  EXPECT_EQ(Ticks(carved, TickMode::kEjecting), 0);
  EXPECT_EQ(Ticks(carved, TickMode::kFault), 0);
  EXPECT_LE(jump_n, kSlewN);
  // 60 a second.
  const std::uint64_t steps = rig.session.volume().volume->revision() - revision;
  EXPECT_GT(steps, 100u);
  EXPECT_LE(steps, 121u);
  // Nothing is left to do after the release.
  const auto volume = rig.session.volume().volume;
  rig.Run(0.5);
  EXPECT_LE(rig.session.volume().volume->revision(), volume->revision() + 1);
}

// What Safety would let through is not what is wanted: at a moderate rate the steps
// stay far below it.
TEST(Carve, AtAModerateRateTheForceHasNoSteps) {
  HapticSettings settings = kCarving;
  settings.carve_rate_per_s = 0.5;
  StylusRig rig("builtin:sphere:32", settings, Resting(kCarveButton, 2.5));
  const std::vector<TickSample> before = rig.Run(1.0);
  const std::vector<TickSample> carved = rig.Run(1.5);
  const double depth_mm = before.back().scp_h_mm[2] - carved.back().scp_h_mm[2];
  std::printf("[ figures  ] carved %.2f mm deep in 1.5 s, force by at most %.4f N per tick\n",
              depth_mm, GreatestJump(carved));
  EXPECT_GT(depth_mm, 1.0);
  EXPECT_LT(GreatestJump(carved), 0.1);
  // The proxy goes down and never up.
  double lowest_mm = 1e9;
  for (const TickSample& s : carved) {
    if (!s.contact) continue;
    EXPECT_LE(s.scp_h_mm[2], lowest_mm + 0.06);  // a count of the sensor
    lowest_mm = std::min(lowest_mm, s.scp_h_mm[2]);
  }
}

// The greatest brush in a big volume.
TEST(Carve, TheGreatestBrushWorksInABigVolume) {
#ifdef PALPATE_SANITIZED
  GTEST_SKIP() << "about speed";
#endif
  HapticSettings settings = kCarving;
  settings.carve_radius_mm = 20.0;
  StylusRig rig("builtin:sphere:256", settings, Resting(kCarveButton, 1.2));
  rig.Run(1.0);
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(TicksInside(rig.Run(0.25)), 0);
  const double took_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const std::uint64_t steps = rig.session.volume().volume->revision() - 1;
  std::printf("[ figures  ] brush of 20 mm in 256 voxels cubed: %.1f ms per step\n",
              1e3 * took_s / static_cast<double>(steps));
  EXPECT_GT(steps, 8u);
}

TEST(Carve, APressIsOneStepToUndo) {
  StylusRig rig("builtin:sphere:32", kCarving, Resting(kCarveButton, 1.5));
  rig.Run(0.9);
  const auto before = rig.session.volume().volume;
  rig.Run(1.0);
  const auto after = rig.session.volume().volume;
  ASSERT_GT(after->revision(), before->revision() + 20);
  const EditOutcome undone = rig.editor.Undo();
  EXPECT_EQ(undone.undo_steps, 0u);
  const auto restored = rig.session.volume().volume;
  for (int i = 0; i < 32 * 32 * 32; ++i) {
    const Vec3i at(i & 31, i >> 5 & 31, i >> 10);
    ASSERT_EQ(restored->StoredVertex(at), before->StoredVertex(at));
  }
}

TEST(Carve, TwoPressesAreTwoSteps) {
  const HandAt hand = [](double time_s) {
    StylusScript::Target target = Resting(kCarveButton, 2.0)(time_s);
    if (time_s > 1.4 && time_s < 1.6) target.buttons = 0;
    return target;
  };
  StylusRig rig("builtin:sphere:32", kCarving, hand);
  rig.Run(2.2);
  EXPECT_EQ(rig.editor.Undo().undo_steps, 1u);
  EXPECT_EQ(rig.editor.Undo().undo_steps, 0u);
}

TEST(Carve, ChangesNothingBeyondItsRadius) {
  StylusRig rig("builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0));
  const std::vector<TickSample> approach = rig.Run(1.0);
  const VolumeState before = rig.session.volume();
  const std::vector<TickSample> carved = rig.Run(2.1);
  const VolumeState after = rig.session.volume();
  int changed = 0;
  for (int i = 0; i < 32 * 32 * 32; ++i) {
    const Vec3i at(i & 31, i >> 5 & 31, i >> 10);
    const double was = before.volume->StoredVertex(at), is = after.volume->StoredVertex(at);
    EXPECT_LE(is, was);
    if (is == was) continue;
    ++changed;
    const Vec3 p_D = after.X_DI.Apply(at.cast<double>());
    double nearest_mm = 1e9;
    for (const TickSample& s : carved) {
      nearest_mm = std::min(nearest_mm, (ToVec3(s.scp_h_mm) - p_D).norm());
    }
    EXPECT_LT(nearest_mm, kCarving.carve_radius_mm + 0.01);
  }
  EXPECT_GT(changed, 10);
}

TEST(Carve, ANegativeRateAddsAndLiftsTheStylus) {
  HapticSettings settings = kCarving;
  settings.carve_rate_per_s = -0.2;
  StylusRig rig("builtin:sphere:32", settings, Resting(kCarveButton, 2.0));
  const std::vector<TickSample> before = rig.Run(1.0);
  const std::vector<TickSample> grown = rig.Run(1.0);
  const double height_mm = grown.back().scp_h_mm[2] - before.back().scp_h_mm[2];
  const double jump_n = GreatestJump(grown);
  std::printf(
      "[ figures  ] grew %.2f mm, force by at most %.4f N per tick, %ld ticks of "
      "ejection\n",
      height_mm, jump_n, Ticks(grown, TickMode::kEjecting));
  EXPECT_GT(height_mm, 0.3);
  EXPECT_LE(jump_n, kSlewN);
  EXPECT_EQ(TicksInside(grown), 0);
}

// From within a sphere of material that is felt as the free side.
TEST(Carve, TakesAwayWhatTheOtherSideFeels) {
  HapticSettings settings = kCarving;
  settings.free_side = FreeSide::kAbove;
  const HandAt hand = [](double time_s) {
    StylusScript::Target target;
    target.p_DTarget_mm = Vec3(1, 2, 35.0 * std::min(1.0, 2.0 * time_s));
    target.buttons = time_s > 1.0 ? kCarveButton : 0;
    return target;
  };
  StylusRig rig("builtin:sphere:32", settings, hand);
  const std::vector<TickSample> before = rig.Run(1.0);
  ASSERT_TRUE(before.back().contact);
  const std::vector<TickSample> carved = rig.Run(1.0);
  EXPECT_GT(carved.back().scp_h_mm[2], before.back().scp_h_mm[2] + 0.5);
  EXPECT_EQ(TicksInside(carved), 0);
  EXPECT_LE(GreatestJump(carved), kSlewN);
}

TEST(Carve, ASlideCarvesAGroove) {
  const HandAt hand = [](double time_s) {
    StylusScript::Target target = Resting(kCarveButton, 3.0)(time_s);
    target.p_DTarget_mm.x() = 6.0 * std::sin(4.0 * std::max(0.0, time_s - 1.0));
    return target;
  };
  StylusRig rig("builtin:bumps:48", kCarving, hand);
  rig.lag_ticks = 40;  // an editor that is late
  rig.Run(1.0);
  const std::vector<TickSample> carved = rig.Run(2.0);
  EXPECT_EQ(TicksInside(carved), 0);
  EXPECT_EQ(Ticks(carved, TickMode::kFault), 0);
  EXPECT_LE(GreatestJump(carved), kSlewN);
  EXPECT_LT(carved.back().scp_h_mm[2], carved.front().scp_h_mm[2] - 0.5);
}

TEST(Carve, DoesNothingInThinAirOrWithTheToolOffOrAnotherButton) {
  HapticSettings off = kCarving;
  off.carve_tool = false;
  HapticSettings still = kCarving;
  still.carve_rate_per_s = 0.0;
  // Farther from any voxel than the radius.
  StylusRig rigs[] = {{"builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0, Vec3(78, 0, 0))},
                      {"builtin:sphere:32", off, Resting(kCarveButton, 3.0)},
                      {"builtin:sphere:32", still, Resting(kCarveButton, 3.0)},
                      {"builtin:sphere:32", kCarving, Resting(kClutchButton | 4u, 3.0)}};
  for (StylusRig& rig : rigs) {
    rig.Run(1.5);
    EXPECT_EQ(rig.session.volume().volume->revision(), 1u);
  }
}

// The loop cannot be hurt by a volume that is exchanged in mid-stroke.
TEST(Carve, AnotherVolumeIsAnotherStroke) {
  StylusRig rig("builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0));
  rig.Run(1.5);
  rig.session.Load(
      {.source = "builtin:gyroid:32"}, [](std::string_view, double) {}, [] { return false; });
  const std::vector<TickSample> after = rig.Run(1.0);
  EXPECT_EQ(TicksInside(after), 0);
  EXPECT_LE(GreatestJump(after), kSlewN);
  EXPECT_EQ(rig.editor.Undo().undo_steps, 0u);
}

// Of the stylus, as a map of D to itself.
RigidMotion MotionBetween(const TickSample& from, const TickSample& to) {
  const auto turn = [](const TickSample& s) {
    return Eigen::Quaterniond(s.stylus_orientation[0], s.stylus_orientation[1],
                              s.stylus_orientation[2], s.stylus_orientation[3]);
  };
  RigidMotion motion;
  motion.R = turn(to) * turn(from).conjugate();
  motion.t_mm = ToVec3(to.hip_mm) - motion.R * ToVec3(from.hip_mm);
  return motion;
}

double Distance(const Registration& a, const Registration& b) {
  return (a.X_DW.linear - b.X_DW.linear).norm() + (a.X_DW.translation - b.X_DW.translation).norm();
}

Registration Moved(const RigidMotion& motion, const Registration& from) {
  Registration to = from;
  to.X_DW.linear = motion.R * from.X_DW.linear;
  to.X_DW.translation = motion.Apply(from.X_DW.translation);
  return to;
}

// Sweeps about with the button held from 1 s until 2 s.
HandAt Sweeping(std::uint32_t buttons) {
  return [=](double time_s) {
    StylusScript::Target target = Resting(buttons, 2.0)(time_s);
    if (time_s > 1.0) {
      const double angle = 9.0 * (time_s - 1.0);
      target.p_DTarget_mm += Vec3(20.0 * std::sin(angle), -15.0 * (1.0 - std::cos(angle)),
                                  10.0 * std::sin(1.7 * angle));
    }
    return target;
  };
}

struct Held {
  const TickSample* first = nullptr;
  const TickSample* last = nullptr;
};

Held HeldTicks(const std::vector<TickSample>& samples) {
  Held held;
  for (const TickSample& s : samples) {
    if ((s.buttons & kClutchButton) == 0) continue;
    if (!held.first) held.first = &s;
    held.last = &s;
  }
  return held;
}

TEST(Clutch, MovesTheVolumeRigidlyWithTheStylusAndWithoutForce) {
  for (const int lag_ticks : {0, 1, 7, 50}) {
    StylusRig rig("builtin:bumps:32", kClutching, Sweeping(kClutchButton));
    rig.lag_ticks = lag_ticks;
    std::vector<TickSample> samples = rig.Run(0.9);
    ASSERT_TRUE(samples.back().contact);
    const Registration before = rig.session.volume().registration;
    samples = rig.Run(1.2);
    const Held held = HeldTicks(samples);
    ASSERT_TRUE(held.first && held.last);
    EXPECT_GT(held.last->tick - held.first->tick, 950u);
    for (const TickSample& s : samples) {
      if ((s.buttons & kClutchButton) == 0) continue;
      EXPECT_EQ(s.mode, TickMode::kSuspended);
      EXPECT_EQ(Force(s), Vec3::Zero());
      EXPECT_FALSE(s.contact);
    }
    const RigidMotion motion = MotionBetween(*held.first, *held.last);
    EXPECT_GT(motion.t_mm.norm(), 1.0);
    EXPECT_GT(Eigen::AngleAxisd(motion.R).angle(), 0.01);
    const Registration after = rig.session.volume().registration;
    EXPECT_LT(Distance(after, Moved(motion, before)), 1e-9) << lag_ticks;
    EXPECT_EQ(after.device_mm_per_volume_mm, before.device_mm_per_volume_mm);
    // It stays.
    const std::vector<TickSample> later = rig.Run(0.5);
    EXPECT_EQ(Distance(rig.session.volume().registration, after), 0.0);
    samples.insert(samples.end(), later.begin(), later.end());
    const auto release = std::find_if(samples.begin(), samples.end(), [&](const TickSample& s) {
      return s.tick == held.last->tick;
    });
    EXPECT_LE(GreatestJump({release, samples.end()}), kSlewN);
    EXPECT_EQ(TicksInside(samples), 0);
  }
}

TEST(Clutch, FollowsSixtyTimesASecond) {
  StylusRig rig("builtin:bumps:32", kClutching, Sweeping(kClutchButton));
  rig.Run(1.0);
  const std::uint64_t before = rig.session.volume().settings_revision;
  rig.Run(1.2);
  const std::uint64_t moves = rig.session.volume().settings_revision - before;
  EXPECT_GE(moves, 57u);
  EXPECT_LE(moves, 61u);
}

TEST(Clutch, AVolumeThatIsMovedMeanwhileKeepsThatMove) {
  StylusRig rig("builtin:bumps:32", kClutching, Sweeping(kClutchButton));
  std::vector<TickSample> samples = rig.Run(1.5);
  const Vec3 aside_mm(3, 0, 0);
  const Registration half = rig.session.volume().registration;
  const TickSample* at = nullptr;  // of the last step
  for (const TickSample& s : samples) {
    if (s.mode == TickMode::kSuspended) at = &s;
  }
  ASSERT_TRUE(at != nullptr);
  rig.session.Move([&](const VolumeState& state) {
    return Apply({.translate_D_mm = aside_mm}, state.volume->metadata(), rig.session.device(),
                 state.registration);
  });
  const Vec3 moved = rig.session.volume().registration.p_DCenter_mm - half.p_DCenter_mm;
  EXPECT_LT((moved - aside_mm).norm(), 1e-12);
  rig.Run(0.7);
  EXPECT_GT((rig.session.volume().registration.p_DCenter_mm - half.p_DCenter_mm).norm(), 3.0);
}

TEST(Clutch, ReleasedInsideTheMaterialTheForceComesGently) {
  for (const bool passivity : {false, true}) {
    HapticSettings settings = kClutching;
    settings.passivity_control = passivity;
    // To 3 mm below the surface while nothing is felt.
    const HandAt hand = [](double time_s) {
      StylusScript::Target target;
      target.p_DTarget_mm = Vec3(1, 2, 22);
      target.buttons = time_s > 1.0 && time_s <= 1.5 ? kClutchButton : 0;
      return target;
    };
    StylusRig rig("builtin:sphere:32", settings, hand);
    rig.session.SetForcesOff(true);
    std::vector<TickSample> samples = rig.Run(1.2);
    rig.session.SetForcesOff(false);
    std::vector<TickSample> released = rig.Run(2.0);
    EXPECT_EQ(Ticks(samples, TickMode::kSuspended), 1200);
    EXPECT_EQ(Ticks(released, TickMode::kFault), 0);
    EXPECT_LE(GreatestJump(released), kSlewN);
    EXPECT_EQ(TicksInside(released), 0);
    EXPECT_TRUE(released.back().contact);
    std::printf(
        "[ figures  ] released inside, passivity %d: force up to %.2f N at the end, by at "
        "most %.3f N per tick\n",
        passivity, Force(released.back()).norm(), GreatestJump(released));
  }
}

TEST(Clutch, DoesNothingWithTheToolOffOrAnotherButton) {
  StylusRig rigs[] = {{"builtin:bumps:32", {}, Sweeping(kClutchButton)},
                      {"builtin:bumps:32", kClutching, Sweeping(kCarveButton)}};
  for (StylusRig& rig : rigs) {
    const Registration before = rig.session.volume().registration;
    const std::vector<TickSample> samples = rig.Run(1.5);
    EXPECT_EQ(Ticks(samples, TickMode::kSuspended), 0);
    EXPECT_EQ(Distance(rig.session.volume().registration, before), 0.0);
  }
}

TEST(Tools, BothButtonsAtOnceMoveAndDoNotCarve) {
  HapticSettings settings = kCarving;
  settings.clutch_tool = true;
  StylusRig rig("builtin:bumps:32", settings, Sweeping(kCarveButton | kClutchButton));
  const Registration before = rig.session.volume().registration;
  rig.Run(1.9);
  EXPECT_EQ(rig.session.volume().volume->revision(), 1u);
  EXPECT_GT(Distance(rig.session.volume().registration, before), 1.0);
}

// With the threads of the daemon.
TEST(Tools, TheServoGoesOnWhileTheToolsWork) {
  HapticSettings settings = kCarving;
  settings.clutch_tool = true;
  const HandAt hand = [](double time_s) {
    StylusScript::Target target = Resting(0, 0.0)(time_s);
    // Carve, move, carve ...
    const double phase = std::fmod(time_s, 0.5);
    target.buttons = phase < 0.25 ? kCarveButton : phase < 0.4 ? kClutchButton : 0u;
    return target;
  };
  SimulatedDevice device(std::make_unique<testing::HandScript>(hand));
  SceneInbox inbox;
  const auto outbox = std::make_unique<TickOutbox>();
  Pump pump(*outbox);
  Session session(device.spec(), inbox, pump, VolumeLoader{});
  VolumeEditor editor(session);
  const auto tools = std::make_shared<StylusTools>(session, editor);
  pump.Subscribe(tools);
  session.SetInitial({.haptics = settings});
  session.Load(
      {.source = "builtin:sphere:32"}, [](std::string_view, double) {}, [] { return false; });
  const Registration before = session.volume().registration;
  RealtimeOptions options;
  options.lock_memory = false;
  ServoLoop servo(device, inbox, *outbox, options, SafetyLimits{});
  tools->Start();
  pump.Start();
  servo.Start();
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  servo.Stop();
  pump.Stop();
  tools->Stop();
  EXPECT_GT(servo.ticks() + servo.missed_ticks(), 2400u);
  EXPECT_GT(servo.ticks(), 1000u);
  EXPECT_EQ(servo.faulty_ticks(), 0u);
  EXPECT_GT(session.volume().volume->revision(), 10u);
  EXPECT_GT(Distance(session.volume().registration, before), 0.0);
}

}  // namespace
}  // namespace palpate
