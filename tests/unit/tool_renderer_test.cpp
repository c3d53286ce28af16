// The force and the torque of a tool, and the energy that a hand gets from them.
#include "server/haptics/tool/tool_renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include "server/servo/tick_computation.h"
#include "tests/support/hand_loop.h"
#include "tests/support/light_hands.h"
#include "tests/support/tick_rig.h"
#include "tests/support/tool_rig.h"

namespace palpate {
namespace {

using testing::kLoopTickS;
using testing::Turn;

constexpr double kTorqueNMm = 1e6;  // of a device: never the limit

// A tool on a surface, with the state of a renderer.
class Chain {
 public:
  Chain(const testing::PlacedVolume& placed, const RigidTool& tool, bool has_torque) {
    felt.tool = tool;
    felt.surface[0] = placed.surface;
    felt.cache[0] = cache_.get();
    state->device.max_torque_n_mm = has_torque ? kTorqueNMm : 0.0;
    if (has_torque) state->device.max_force_n = 1e6;
  }

  ToolOutput Step(const ToolPose& stylus, double dt_s = kLoopTickS) {
    return StepWithTool(felt, settings, stylus.p_DS_mm, stylus.R_DS, dt_s, kToolWork, *state,
                        memory);
  }

  // As a device does: its torque has a limit.
  Wrench Write(const ToolOutput& output) {
    Wrench written{output.haptic.force_D_n, output.torque_D_n_mm};
    const double torque_n_mm = written.torque_n_mm.norm(), most = state->device.max_torque_n_mm;
    if (torque_n_mm > most) written.torque_n_mm *= most / torque_n_mm;
    TellWrittenWrench(written, felt.tool.rotation_length_mm, *state, memory);
    return written;
  }

  FeltTool felt;
  HapticSettings settings{.stiffness_n_per_mm = 1.0};
  std::unique_ptr<RendererState> state = std::make_unique<RendererState>();
  ToolMemory memory;

 private:
  std::unique_ptr<ToolCellCache> cache_ = std::make_unique<ToolCellCache>();
};

// --- Led hands: their ways are given, and the forces do not change them

struct Led {
  // The greatest net work on the hand up to any time.
  double given_mj = 0.0;
  double unguarded_mj = 0.0;  // of the spring's force alone, without the tank
  int contacts = 0;
};

// Goals at random, up to 3 mm deep and somewhat turned; 10 cm/s and 2 rad/s for 20 s.
Led Lead(Chain& chain, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    return Vec3(normal(random), normal(random), normal(random)).normalized();
  };
  // Begins in free space, with an empty spring.
  ToolPose hand, goal;
  do {
    hand = {20.0 * direction(), Turn(3.0, direction())};
    chain.memory = ToolMemory();
  } while (chain.Step(hand).tool.mode != ProxyMode::kFree);
  Wrench last;
  Vec3 last_spring_n = Vec3::Zero();
  double given_mj = 0.0, unguarded_mj = 0.0;
  Led led;
  for (int n = 0; n < 20'000; ++n) {
    const ToolPose tool = chain.memory.state.pose;
    if (n % 150 == 0) goal = Moved(tool, {8.0 * direction(), 0.4 * direction()});
    const ToolMove way = MoveBetween(hand, goal);
    ToolPose next = Moved(hand, {way.way_mm * std::min(1.0, 0.1 / way.way_mm.norm()),
                                 way.turn_rad * std::min(1.0, 0.002 / way.turn_rad.norm())});
    // No hand presses harder.
    const ToolMove depth = MoveBetween(tool, next);
    next = Moved(tool, {depth.way_mm * std::min(1.0, 2.0 / depth.way_mm.norm()),
                        depth.turn_rad * std::min(1.0, 0.2 / depth.turn_rad.norm())});
    const ToolMove moved = MoveBetween(hand, next);
    const ToolOutput output = chain.Step(next);
    const Wrench written = chain.Write(output);
    given_mj += 0.5 * (written.force_n + last.force_n).dot(moved.way_mm) +
                0.5 * (written.torque_n_mm + last.torque_n_mm).dot(moved.turn_rad);
    unguarded_mj += 0.5 * (output.haptic.spring_D_n + last_spring_n).dot(moved.way_mm);
    led.given_mj = std::max(led.given_mj, given_mj);
    led.unguarded_mj = std::max(led.unguarded_mj, unguarded_mj);
    led.contacts += output.tool.touching != 0;
    hand = next;
    last = written;
    last_spring_n = output.haptic.spring_D_n;
  }
  return led;
}

TEST(ToolRenderer, WithTorqueALedHandGetsNoEnergy) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  for (const double rho_mm : {10.0, 30.0, 100.0}) {
    Chain chain(gyroid, testing::Rod(8, 16.0, rho_mm), true);
    const Led led = Lead(chain, 1);
    EXPECT_GT(led.contacts, 4000);  // clang draws the numbers in another order
    EXPECT_LE(led.given_mj, 0.005) << rho_mm;
  }
}

// A torque at its limit takes too little work: without the tank, tens of mJ come back as force.
TEST(ToolRenderer, WithALittleTorqueALedHandGetsNoEnergy) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  for (const double most_n_mm : {1.6, 12.0}) {
    Chain chain(gyroid, testing::Rod(8, 60.0, 30.0), true);
    chain.settings.passivity_control = false;
    chain.state->device.max_torque_n_mm = most_n_mm;
    const Led led = Lead(chain, 5);
    EXPECT_GT(led.contacts, 5000);
    EXPECT_LE(led.given_mj, kTankCreditMj) << most_n_mm;
  }
}

// The stylus is turned, and the force alone is felt: without the tank that throws the hand.
TEST(ToolRenderer, WithoutTorqueALedHandGetsNoMoreThanTheCredit) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  double unguarded_mj = 0.0;
  for (const double rho_mm : {10.0, 30.0, 100.0, 300.0}) {
    Chain chain(gyroid, testing::Rod(8, 60.0, rho_mm), false);
    const Led led = Lead(chain, 2);
    EXPECT_GT(led.contacts, 5000);
    EXPECT_LE(led.given_mj, 0.2) << rho_mm;
    unguarded_mj = std::max(unguarded_mj, led.unguarded_mj);
  }
  EXPECT_GT(unguarded_mj, 20.0);
}

// Who does not turn the stylus feels the spring as it is; with torque, who turns it, too.
TEST(ToolRenderer, TheTankDoesNotChangeAPress) {
  const testing::PlacedVolume sphere = testing::PlaceBuiltin("builtin:sphere:64", 0.5);
  for (const bool has_torque : {false, true}) {
    Chain chain(sphere, testing::Rod(4, 6.0), has_torque);
    double most_n = 0.0, most_n_mm = 0.0;
    for (int n = 0; n < 400; ++n) {
      const double z_mm = 14.0 - 4.0 * std::sin(0.01 * n);
      const ToolPose hand = has_torque
                                ? ToolPose{Vec3(0, 3, z_mm), Turn(1.2 + 0.002 * n, Vec3::UnitX())}
                                : ToolPose{Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())};
      const ToolOutput output = chain.Step(hand);
      EXPECT_LE((output.haptic.force_D_n - output.haptic.spring_D_n).norm(),
                1e-3 * output.haptic.spring_D_n.norm());
      most_n = std::max(most_n, output.haptic.force_D_n.norm());
      most_n_mm = std::max(most_n_mm, output.torque_D_n_mm.norm());
    }
    EXPECT_GT(most_n, 1.0);
    EXPECT_EQ(most_n_mm > 1.0, has_torque);
  }
}

// The ball is beside the grip, so the tool turns under a press, and its spring holds more than the
// force shows.
TEST(ToolRenderer, TheTankDoesNotChangeAPressBesideTheGrip) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  RigidTool tool = testing::Rod(1, 0.0);
  tool.ball[0].p_SBall_mm = 30.0 * Vec3::UnitX();
  Chain chain(floor, tool, false);
  for (int n = 0; n < 300; ++n) {
    const Vec3 p_mm(-20, 0, 1.0 - 3.0 * std::sin(0.02 * n));
    const ToolOutput output = chain.Step({p_mm, Turn(0.0, Vec3::UnitX())});
    EXPECT_LE((output.haptic.force_D_n - output.haptic.spring_D_n).norm(),
              1e-3 * output.haptic.spring_D_n.norm())
        << n;
  }
}

// The control softens a point and a tool of one ball alike, and the tank adds nothing to that.
TEST(ToolRenderer, TheTankAddsNothingToThePassivityControl) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  for (const bool has_torque : {false, true}) {
    Chain chain(floor, testing::Rod(1, 0.0), has_torque);
    chain.settings = {.stiffness_n_per_mm = 2.0, .passivity_control = true};
    RendererState point;
    point.device = chain.state->device;
    const auto step = [&](double z_mm) {
      const HapticOutput felt =
          StepRenderer(floor.surface, chain.settings, Vec3(0, 0, z_mm), kLoopTickS, point);
      const double tool_n =
          chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())}).haptic.force_D_n.norm();
      EXPECT_NEAR(tool_n, felt.force_D_n.norm(), 0.15);
    };
    for (double z_mm = 1.0; z_mm > -2.0; z_mm -= 0.05) step(z_mm);
    for (int n = 0; n < 4000; ++n) step(-1.5 - 0.5 * std::cos(0.08 * n));
    for (int n = 0; n < 5000; ++n) step(-2.0);
  }
}

// Each way out ends between two ticks, with the old force on the hand for a part of the tick.
TEST(ToolRenderer, TheTankDoesNotChangeTaps) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), false);
  chain.settings.stiffness_n_per_mm = 2.0;
  for (int tap = 0; tap < 100; ++tap) {
    double most_n = 0.0;
    for (int n = 0; n <= 40; ++n) {
      const double z_mm = 1.0 - 0.05 * n;
      most_n = std::max(
          most_n, chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())}).haptic.force_D_n.z());
    }
    for (double z_mm = -1.0; z_mm <= 2.0; z_mm += 0.6 + 0.001 * tap) {
      chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())});
    }
    ASSERT_NEAR(most_n, 2.0, 0.02) << tap;
  }
}

// A hand may get faster on its way out.
TEST(ToolRenderer, TapsThatEndInHasteGiveNoEnergy) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), false);
  chain.settings.stiffness_n_per_mm = 2.0;
  double given_mj = 0.0, last_n = 0.0, last_mm = 1.0;
  const auto go = [&](double z_mm) {
    const double n = chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())}).haptic.force_D_n.z();
    given_mj += 0.5 * (last_n + n) * (z_mm - last_mm);
    EXPECT_LE(given_mj, kTankCreditMj + 1e-3);
    last_n = n;
    last_mm = z_mm;
  };
  for (int tap = 0; tap < 1000; ++tap) {
    for (double z_mm = 1.0; z_mm > -1.0; z_mm -= 0.01) go(z_mm);
    double way_mm = 0.002;
    while (last_mm < 1.0) {
      go(last_mm + way_mm);
      way_mm = std::min(0.2, 1.2 * way_mm);
    }
  }
}

// A ball beside the grip is turned into the floor, again and again: nobody worked for that. Then
// the hand presses.
TEST(ToolRenderer, AfterTurnsAPressIsASpringFromThere) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  RigidTool tool = testing::Rod(2, 0.0);
  tool.ball[0].p_SBall_mm = tool.ball[1].p_SBall_mm = 15.0 * Vec3::UnitX();
  Chain chain(floor, tool, false);
  double z_mm = 0.5, given_mj = 0.0, last_n = 0.0;
  const auto step = [&](double to_mm, double turn_rad) {
    const ToolOutput output = chain.Step({Vec3(0, 0, to_mm), Turn(turn_rad, Vec3::UnitY())});
    const double force_n = output.haptic.force_D_n.z();
    given_mj += 0.5 * (last_n + force_n) * (to_mm - z_mm);
    EXPECT_LE(given_mj, kTankCreditMj + 1e-3);
    z_mm = to_mm;
    last_n = force_n;
  };
  for (int cycle = 0; cycle < 5; ++cycle) {
    for (int n = 0; n <= 100; ++n) step(0.5, 0.002 * n);
    for (int n = 0; n <= 100; ++n) step(0.5 + 0.03 * n, 0.2);  // out, with what the spring gives
    step(3.5, 0.0);
    step(0.5, 0.0);
  }
  for (int n = 0; n <= 100; ++n) step(0.5, 0.002 * n);
  EXPECT_LT(last_n, 0.1);
  for (int n = 0; n <= 100; ++n) step(0.5 - 0.01 * n, 0.2);
  EXPECT_NEAR(last_n, 1.0, 0.1);
}

// --- Another surface or tool under a pressed stylus

// The tool comes to rest within the work, whatever moves; no ball is in the object then.
TEST(ToolRenderer, ChangesUnderLoadAreFeltWithinTheWorkAndTheForce) {
  const testing::PlacedVolume gyroid = testing::PlaceBuiltin("builtin:gyroid:64", 1.0);
  Chain chain(gyroid, testing::Rod(8, 16.0), true);
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> one(-1.0, 1.0);
  chain.Step({});
  int contacts = 0, ejecting = 0;
  for (int n = 0; n < 20'000; ++n) {
    if (n % 200 == 0) {
      ++chain.felt.surface[0].geometry_revision;
      if (n % 400 == 0) chain.felt.tool = testing::Rod(8, 16.0 + 8.0 * one(random), 30.0);
    }
    if (n % 100 == 0) chain.felt.surface[0].isovalue = 0.5 + 0.1 * one(random);
    const ToolOutput output =
        chain.Step({Vec3(std::sin(1e-3 * n), 0, 0), Turn(2e-4 * n, Vec3(1, 2, 3))});
    ASSERT_LE(output.haptic.proxy.tetrahedra, kToolWork);
    contacts += output.tool.touching != 0;
    const bool is_ejecting = output.tool.mode == ProxyMode::kEjecting;
    ejecting = is_ejecting ? ejecting + 1 : 0;
    ASSERT_LE(ejecting, 50);
    if (is_ejecting || output.tool.mode == ProxyMode::kInside || n % 20 != 0) continue;
    lab::ToolJudge judge(chain.felt.surface[0], chain.felt.tool);
    ASSERT_EQ(judge.Falls(output.tool.pose, output.tool.pose), 0) << n;
  }
  EXPECT_GT(contacts, 3000);
}

TEST(ToolRenderer, AnotherRotationLengthKeepsTheForce) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), true);
  chain.settings.passivity_control = true;
  const ToolPose pressed{Vec3(0, 0, -2.0), Turn(0.35, Vec3::UnitX())};
  for (int n = 0; n <= 400; ++n) {
    chain.Step({Vec3(0, 0, 2.0 - 0.01 * n), Turn(0.35 * n / 400, Vec3::UnitX())});
  }
  chain.felt.tool.rotation_length_mm = 80.0;
  ++chain.felt.surface[0].geometry_revision;
  for (int n = 0; n < 300; ++n) {
    EXPECT_NEAR(chain.Step(pressed).haptic.force_D_n.z(), 2.0, 0.1) << n;
  }
}

// The work that moves the surface is no debt of the hand's.
TEST(ToolRenderer, ASurfaceThatRisesUnderAStillHandIsFeltInFull) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  for (const bool has_torque : {false, true}) {
    for (const bool is_controlled : {false, true}) {
      Chain chain(floor, testing::Rod(2, 0.0), has_torque);
      chain.settings.passivity_control = is_controlled;
      const ToolPose pressed{Vec3(0, 0, -0.5), Turn(0.0, Vec3::UnitX())};
      for (int n = 0; n <= 100; ++n) {
        chain.Step({Vec3(0, 0, 0.5 - 0.01 * n), Turn(0.0, Vec3::UnitX())});
      }
      chain.felt.surface[0].isovalue -= 1.5 / 39.0;  // a voxel is a mm
      EXPECT_NEAR(chain.Step(pressed).haptic.force_D_n.z(), 2.0, 0.05) << has_torque;
      EXPECT_NEAR(chain.Step(pressed).haptic.force_D_n.z(), 2.0, 0.05) << is_controlled;
    }
  }
}

// Sixty-four balls need some ticks to come out, and then another spring is set.
TEST(ToolRenderer, WhatTakesTicksToSettleAndAnotherStiffnessAreFeltInFull) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  RigidTool flat = testing::Rod(64, 0.0);
  for (int n = 0; n < 64; ++n) flat.ball[n].p_SBall_mm = 0.35 * Vec3(n % 8, n / 8, 0.0);
  Chain chain(floor, flat, false);
  const ToolPose pressed{Vec3(0, 0, -0.5), Turn(0.0, Vec3::UnitX())};
  for (int n = 0; n <= 100; ++n) {
    chain.Step({Vec3(0, 0, 0.5 - 0.01 * n), Turn(0.0, Vec3::UnitX())});
  }
  chain.felt.surface[0].isovalue -= 2.5 / 39.0;  // a voxel is a mm
  EXPECT_TRUE(chain.Step(pressed).tool.capped);
  for (int n = 0; n < 50; ++n) chain.Step(pressed);
  EXPECT_NEAR(chain.Step(pressed).haptic.force_D_n.z(), 3.0, 0.03);
  chain.settings.stiffness_n_per_mm = 3.0;
  EXPECT_NEAR(chain.Step(pressed).haptic.force_D_n.z(), 9.0, 0.09);
}

TEST(ToolRenderer, WhileItTouchesAnIsovalueGlidesAndARefinementWaits) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), true);
  chain.state->glides = true;
  const auto at = [&](double z_mm) {
    return chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())}).haptic.isovalue;
  };
  for (int n = 0; n <= 100; ++n) at(0.5 - 0.01 * n);
  const double target = 0.5 - 4.0 / 39.0;
  chain.felt.surface[0].Refine(2);
  chain.felt.surface[0].isovalue = target;
  EXPECT_GT(at(-0.5), target + 3.0 / 39.0);
  EXPECT_EQ(chain.memory.felt.refinement, 1);
  for (int n = 0; n < 2000; ++n) at(-0.5);
  EXPECT_EQ(at(-0.5), target);
  EXPECT_EQ(chain.memory.felt.refinement, 1);
  at(9.0);
  at(9.0);
  EXPECT_EQ(chain.memory.felt.refinement, 2);
}

TEST(ToolRenderer, DampingActsInContactAndViscosityEverywhere) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), true);
  chain.settings.damping_n_s_per_m = 4.0;
  chain.settings.viscosity_n_s_per_m = 1.0;
  ToolOutput output;
  const auto press = [&](double from_mm, double to_mm) {
    for (double z_mm = from_mm; z_mm > to_mm; z_mm -= 0.1) {
      output = chain.Step({Vec3(0, 0, z_mm), Turn(0.0, Vec3::UnitX())});
    }
    return output.haptic.force_D_n.z() - output.haptic.spring_D_n.z();
  };
  // At 100 mm/s.
  EXPECT_NEAR(press(10.0, 2.0), 0.1, 0.01);
  EXPECT_NEAR(press(2.0, -2.0), 0.5, 0.05);
}

// What was not on the hand, it did not work against.
TEST(ToolRenderer, TheTankCountsTheForceThatWasWritten) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(2, 0.0), false);
  ToolOutput output;
  for (int n = 0; n <= 300; ++n) {
    output = chain.Step({Vec3(0, 0, 1.0 - 0.01 * n), Turn(0.0, Vec3::UnitX())});
    TellWrittenWrench({}, chain.felt.tool.rotation_length_mm, *chain.state, chain.memory);
  }
  EXPECT_LT(output.haptic.force_D_n.z(), 1.6);
  EXPECT_NEAR(output.haptic.spring_D_n.z(), 2.0, 0.01);
}

TEST(ToolRenderer, TheDensityIsThatOfTheFirstBall) {
  const testing::PlacedVolume floor = testing::PlaceFloor();
  Chain chain(floor, testing::Rod(4, 6.0), true);
  const ToolOutput output = chain.Step({Vec3(0, 0, 5.0), Turn(1.0, Vec3::UnitX())});
  EXPECT_NEAR(output.haptic.proxy.density, 0.5 - 5.0 / 39.0, 1e-7);
}

// --- Light hands in a closed loop

// A rod stands on a floor. It is pressed, or turned about its grip: then the hand's way in mm is ρ
// times the angle, and its force is the torque by ρ.
testing::LoopResult Hold(const testing::Hand& hand, double stiffness, bool is_late, bool turns,
                         bool is_controlled) {
  static const testing::PlacedVolume floor = testing::PlaceFloor();
  RigidTool tool = testing::Rod(2, 0.0);
  const double rho_mm = tool.rotation_length_mm;
  if (turns) tool.ball[0].p_SBall_mm = tool.ball[1].p_SBall_mm = rho_mm * Vec3::UnitX();
  Chain chain(floor, tool, true);
  chain.settings.stiffness_n_per_mm = stiffness;
  chain.settings.passivity_control = is_controlled;
  const auto render = [&](const Vec3& p_mm, double dt_s, const Vec3& written_n) {
    // A wall that gives way neither here nor there: the grip is held where it is.
    const ToolPose stylus = turns ? ToolPose{Vec3::Zero(), Turn(-p_mm.z() / rho_mm, Vec3::UnitY())}
                                  : ToolPose{p_mm, Eigen::Quaterniond::Identity()};
    Wrench written;
    if (turns) {
      written.torque_n_mm.y() = -rho_mm * written_n.z();
    } else {
      written.force_n = written_n;
    }
    TellWrittenWrench(written, rho_mm, *chain.state, chain.memory);
    const ToolOutput output = chain.Step(stylus, dt_s);
    return turns ? Vec3(0, 0, -output.torque_D_n_mm.y() / rho_mm) : output.haptic.force_D_n;
  };
  return testing::HandLoop(hand, {.is_late = is_late}).Run(render, [](const Vec3& p_mm) {
    return std::max(0.0, -p_mm.z());
  });
}

TEST(ToolRenderer, NoLightHandGainsEnergyFromForceOrTorque) {
  double uncontrolled_mj = 0.0;
  for (const bool turns : {false, true}) {
    testing::ForEachLightHand([&](const testing::Hand& hand, double stiffness, bool is_late) {
      EXPECT_LE(Hold(hand, stiffness, is_late, turns, true).given_mj, 0.15) << "turns " << turns;
      if (stiffness != 2.0) return;
      uncontrolled_mj =
          std::max(uncontrolled_mj, Hold(hand, stiffness, is_late, turns, false).given_mj);
    });
  }
  EXPECT_GT(uncontrolled_mj, 1.5);
}

// --- Bad poses

TEST(ToolRenderer, APoseThatIsNoneIsRejectedAndChangesNothing) {
  const testing::PlacedVolume sphere = testing::PlaceBuiltin("builtin:sphere:64", 0.5);
  Chain chain(sphere, testing::Rod(4, 6.0), true);
  // Across the top of the sphere, a ball beside the grip touches.
  const Eigen::Quaterniond across = Turn(1.5, Vec3::UnitX());
  const ToolPose pressed{Vec3(0, 4, 9.5), across};
  chain.Step({Vec3(0, 4, 16), across});
  const ToolOutput good = chain.Step(pressed);
  EXPECT_GT(good.torque_D_n_mm.norm(), 1.0);
  const double nan = std::nan("");
  for (const ToolPose& bad :
       {ToolPose{Vec3(nan, 0, 0), pressed.R_DS}, ToolPose{pressed.p_DS_mm, {nan, 0, 0, 0}},
        ToolPose{pressed.p_DS_mm, {0, 0, 0, 0}}, ToolPose{pressed.p_DS_mm, {2, 0, 0, 0}}}) {
    const ToolOutput output = chain.Step(bad);
    EXPECT_TRUE(output.haptic.input_rejected);
    EXPECT_LE((output.haptic.force_D_n - good.haptic.force_D_n).norm(), 1e-3);
    EXPECT_LE((output.torque_D_n_mm - good.torque_D_n_mm).norm(), 0.1);
  }
  EXPECT_FALSE(chain.Step(pressed).haptic.input_rejected);
  // A tool is not taken up how nobody holds it.
  chain.memory = ToolMemory();
  EXPECT_TRUE(chain.Step({pressed.p_DS_mm, {nan, 0, 0, 0}}).haptic.force_D_n.isZero());
  EXPECT_FALSE(chain.memory.state.placed);
}

}  // namespace
}  // namespace palpate
