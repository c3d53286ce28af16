// Carving and the clutch in closed loop with a simulated hand, tick by tick.
#include "server/session/tools/tools.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/servo/servo_tick.h"
#include "tests/support/running_session.h"

namespace palpate {
namespace {

// The hand's target and its buttons at a time.
using HandAt = std::function<StylusScript::Target(double time_s)>;

class HandScript final : public StylusScript {
 public:
  explicit HandScript(HandAt hand) : hand_(std::move(hand)) {}
  Target Next(const HandState&, const Wrench&, double dt_s) noexcept override {
    time_s_ += dt_s;
    return hand_(time_s_);
  }

 private:
  HandAt hand_;
  double time_s_ = 0.0;
};

// The loop around a scripted hand without a thread, one millisecond per tick. Every run has the
// same bits.
class StylusRig : public testing::EditableSession {
 public:
  StylusRig(const std::string& source, const HapticSettings& settings, HandAt hand)
      : stylus_(std::make_unique<HandScript>(std::move(hand))), editor(session()) {
    inbox().ReaderRestarts();
    session().SetInitial({.haptics = settings});
    Load(source);
    stylus_.Start();
  }

  // The tools run `lag_ticks` late.
  TickSample Tick() {
    const std::int64_t now_ns = 1'000'000 * ++ticks_;
    const TickSample sample = tick_.Run(*inbox().Acquire(), {now_ns, now_ns, 0});
    tools_->OnSample(sample);
    if (lag_ticks == 0 || ticks_ % lag_ticks == 0) tools_->Work();
    return sample;
  }
  std::vector<TickSample> Run(double seconds) {
    std::vector<TickSample> samples;
    for (int n = 0; n < static_cast<int>(seconds * 1e3 + 0.5); ++n) samples.push_back(Tick());
    return samples;
  }
  std::uint64_t revision() const { return volume()->revision(); }
  VolumePlace registration() { return session().volume().registration; }

  int lag_ticks = 0;

 private:
  SimulatedDevice stylus_;

 public:
  VolumeEditor editor;

 private:
  std::shared_ptr<StylusTools> tools_ = std::make_shared<StylusTools>(session(), editor);
  ServoTick tick_{stylus_};
  std::int64_t ticks_ = 0;
};

Vec3 ToVec3(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
Vec3 Force(const TickSample& sample) { return ToVec3(sample.force_n); }

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
    target.p_MTarget_mm = target_mm + Vec3(0, 0, 15.0 * std::max(0.0, 1.0 - 2.0 * time_s));
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
    const bool judged = s.mode == ProxyMode::kFree || s.mode == ProxyMode::kConstrained;
    const double sign = s.free_side == FreeSide::kBelow ? 1.0 : -1.0;
    return judged && sign * s.density > sign * s.isovalue + 1e-9;
  });
}

long Ticks(const std::vector<TickSample>& samples, ProxyMode mode) {
  return std::count_if(samples.begin(), samples.end(),
                       [&](const TickSample& s) { return s.mode == mode; });
}

// A press after 1 s, and how far the proxy must move along z meanwhile.
struct Carving {
  const char* what;
  std::string source;
  HapticSettings settings;
  HandAt hand;
  double seconds;
  double way_mm;
  double most_jump_n = kSlewN;
  int lag_ticks = 0;
};

HapticSettings CarvingAt(double rate_per_s, double radius_mm = 5.0) {
  HapticSettings settings = kCarving;
  settings.carve_rate_per_s = rate_per_s;
  settings.carve_radius_mm = radius_mm;
  return settings;
}

TEST(Carve, MovesTheSurfaceSmoothlyAndTheProxyStaysOutside) {
  HapticSettings other_side = kCarving;
  other_side.free_side = FreeSide::kAbove;
  HapticSettings with_ball = CarvingAt(2.0, 0.1);
  with_ball.tool_radius_mm = 8.0;
  // From within a sphere of material that is felt as the free side.
  const HandAt from_within = [](double time_s) {
    StylusScript::Target target;
    target.p_MTarget_mm = Vec3(1, 2, 35.0 * std::min(1.0, 2.0 * time_s));
    target.buttons = time_s > 1.0 ? kCarveButton : 0;
    return target;
  };
  const HandAt sliding = [](double time_s) {
    StylusScript::Target target = Resting(kCarveButton, 3.0)(time_s);
    target.p_MTarget_mm.x() = 6.0 * std::sin(4.0 * std::max(0.0, time_s - 1.0));
    return target;
  };
  const HandAt resting = Resting(kCarveButton, 3.0);
  for (const Carving& c :
       {Carving{"lowers it", "builtin:sphere:32", kCarving, resting, 2.0, -1.0},
        // At a moderate rate the steps stay far below what Safety would let through.
        Carving{"moderately", "builtin:sphere:32", CarvingAt(0.5), resting, 1.5, -1.0, 0.1},
        Carving{"adds", "builtin:sphere:32", CarvingAt(-0.2), resting, 1.0, 0.3},
        Carving{"the greatest brush", "builtin:sphere:96", CarvingAt(2.0, 20.0), resting, 0.1,
                -0.05},
        Carving{"a ball", "builtin:sphere:32", with_ball, resting, 2.0, -1.0},
        Carving{"from within", "builtin:sphere:32", other_side, from_within, 1.0, 0.5},
        // By an editor that is late.
        Carving{"a groove", "builtin:bumps:48", kCarving, sliding, 2.0, -0.5, kSlewN, 40}}) {
    SCOPED_TRACE(c.what);
    StylusRig rig(c.source, c.settings, c.hand);
    rig.lag_ticks = c.lag_ticks;
    const std::vector<TickSample> before = rig.Run(1.0);
    ASSERT_TRUE(before.back().contact);
    const std::vector<TickSample> carved = rig.Run(c.seconds);
    const double way_mm = carved.back().scp_h_mm[2] - before.back().scp_h_mm[2];
    EXPECT_GT(way_mm / c.way_mm, 1.0) << way_mm << " mm";
    EXPECT_EQ(TicksInside(carved), 0);
    EXPECT_EQ(Ticks(carved, ProxyMode::kFault), 0);
    EXPECT_LE(GreatestJump(carved), c.most_jump_n);
    if (c.settings.carve_rate_per_s != 0.5) continue;
    // The proxy goes down and never up.
    double lowest_mm = 1e9;
    for (const TickSample& s : carved) {
      if (!s.contact) continue;
      EXPECT_LE(s.scp_h_mm[2], lowest_mm + 0.06);  // a count of the sensor
      lowest_mm = std::min(lowest_mm, s.scp_h_mm[2]);
    }
  }
}

// Sixty edits a second, until the release.
TEST(Carve, APressChangesNothingBeyondItsRadiusAndIsOneStepToUndo) {
  StylusRig rig("builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0));
  rig.Run(1.0);
  const VolumeState before = rig.session().volume();
  const std::vector<TickSample> carved = rig.Run(2.1);
  EXPECT_EQ(Ticks(carved, ProxyMode::kEjecting), 0);
  const VolumeState after = rig.session().volume();
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
  EXPECT_GT(after.volume->revision(), before.volume->revision() + 100);
  rig.Run(0.4);
  EXPECT_LE(rig.revision(), before.volume->revision() + 122);
  EXPECT_EQ(rig.editor.Undo().undo_steps, 0u);
  EXPECT_EQ(rig.hash(), before.volume->bricks().content_hash());
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

double Distance(const VolumePlace& a, const VolumePlace& b) {
  return (a.X_DW.linear - b.X_DW.linear).norm() + (a.X_DW.translation - b.X_DW.translation).norm();
}

VolumePlace Moved(const RigidMotion& motion, const VolumePlace& from) {
  VolumePlace to = from;
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
      target.p_MTarget_mm += Vec3(20.0 * std::sin(angle), -15.0 * (1.0 - std::cos(angle)),
                                  10.0 * std::sin(1.7 * angle));
    }
    return target;
  };
}

TEST(Clutch, MovesTheVolumeRigidlyWithTheStylus) {
  for (const int lag_ticks : {0, 1, 7, 50}) {
    StylusRig rig("builtin:bumps:32", kClutching, Sweeping(kClutchButton));
    rig.lag_ticks = lag_ticks;
    std::vector<TickSample> samples = rig.Run(0.9);
    ASSERT_TRUE(samples.back().contact);
    const VolumePlace before = rig.registration();
    samples = rig.Run(1.2);
    const auto is_held = [](const TickSample& s) { return (s.buttons & kClutchButton) != 0; };
    const auto press = std::ranges::find_if(samples, is_held);
    const auto release = std::find_if_not(press, samples.end(), is_held);
    ASSERT_GT(release - press, 950);
    for (auto s = press; s != release; ++s) {
      ASSERT_EQ(s->mode, ProxyMode::kSuspended);
      ASSERT_EQ(Force(*s), Vec3::Zero());
      ASSERT_FALSE(s->contact);
    }
    const RigidMotion motion = MotionBetween(*press, release[-1]);
    EXPECT_GT(motion.t_mm.norm(), 1.0);
    EXPECT_GT(Eigen::AngleAxisd(motion.R).angle(), 0.01);
    const VolumePlace after = rig.registration();
    EXPECT_LT(Distance(after, Moved(motion, before)), 1e-9) << lag_ticks;
    EXPECT_EQ(after.device_mm_per_volume_mm, before.device_mm_per_volume_mm);
    // It stays.
    std::vector<TickSample> released(release - 1, samples.end());
    std::ranges::copy(rig.Run(0.5), std::back_inserter(released));
    EXPECT_EQ(Distance(rig.registration(), after), 0.0);
    EXPECT_LE(GreatestJump(released), kSlewN);
    EXPECT_EQ(TicksInside(samples) + TicksInside(released), 0);
  }
}

TEST(Clutch, AVolumeThatIsMovedMeanwhileKeepsThatMove) {
  StylusRig rig("builtin:bumps:32", kClutching, Sweeping(kClutchButton));
  std::vector<TickSample> samples = rig.Run(1.5);
  const Vec3 aside_mm(3, 0, 0);
  const VolumePlace half = rig.registration();
  const TickSample* at = nullptr;  // of the last step
  for (const TickSample& s : samples) {
    if (s.mode == ProxyMode::kSuspended) at = &s;
  }
  ASSERT_TRUE(at != nullptr);
  rig.session().Move([&](const VolumeState& state) {
    return Apply({.translate_mm = aside_mm}, state.volume->metadata(), rig.device(),
                 state.registration);
  });
  const Vec3 moved = rig.registration().p_DCenter_mm - half.p_DCenter_mm;
  EXPECT_LT((moved - aside_mm).norm(), 1e-12);
  rig.Run(0.7);
  EXPECT_GT((rig.registration().p_DCenter_mm - half.p_DCenter_mm).norm(), 3.0);
}

TEST(Tools, DoNothingInThinAirOrSwitchedOffOrForAnotherButton) {
  HapticSettings off = kCarving;
  off.carve_tool = false;
  // Farther from any voxel than the radius.
  StylusRig rigs[] = {{"builtin:sphere:32", kCarving, Resting(kCarveButton, 3.0, Vec3(78, 0, 0))},
                      {"builtin:sphere:32", off, Resting(kCarveButton, 3.0)},
                      {"builtin:sphere:32", CarvingAt(0.0), Resting(kCarveButton, 3.0)},
                      {"builtin:sphere:32", kCarving, Resting(kClutchButton | 4u, 3.0)},
                      {"builtin:bumps:32", {}, Sweeping(kClutchButton)},
                      {"builtin:bumps:32", kClutching, Sweeping(kCarveButton)}};
  for (StylusRig& rig : rigs) {
    const VolumePlace before = rig.registration();
    EXPECT_EQ(Ticks(rig.Run(1.5), ProxyMode::kSuspended), 0);
    EXPECT_EQ(rig.revision(), 1u);
    EXPECT_EQ(Distance(rig.registration(), before), 0.0);
  }
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
  testing::RunningSession running({}, std::make_unique<HandScript>(hand));
  VolumeEditor editor(running.session());
  const auto tools = std::make_shared<StylusTools>(running.session(), editor);
  running.pump().Subscribe(tools);
  running.session().SetInitial({.haptics = settings});
  running.Load("builtin:sphere:32");
  const VolumePlace before = running.session().volume().registration;
  tools->Start();
  running.Start();
  EXPECT_TRUE(test::Eventually([&] {
    return running.volume()->revision() > 10 && running.servo().ticks() > 1000 &&
           Distance(running.session().volume().registration, before) > 0.0;
  }));
  running.Stop();
  tools->Stop();
  EXPECT_EQ(running.servo().faulty_ticks(), 0u);
}

}  // namespace
}  // namespace palpate
