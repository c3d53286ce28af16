// A new isovalue under a stylus that touches, in whole ticks.
#include "server/haptics/isovalue_glide.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>

#include "server/servo/tick_computation.h"
#include "tests/support/made_volume.h"
#include "tests/support/tick_rig.h"

namespace palpate {
namespace {

constexpr int kHeadEdge = 36;
const Vec3 kHeadCentre = Vec3::Constant((kHeadEdge - 1) / 2.0);

// A ball whose density falls by 1/32 per mm: its surface is at EvenRadiusAt(isovalue).
double Even(double r_mm) { return 0.5 - (r_mm - 11.0) / 32.0; }
double EvenRadiusAt(double isovalue) { return 11.0 + 32.0 * (0.5 - isovalue); }

// Bone, soft tissue that is the same all over, air.
double Head(double r_mm) {
  if (r_mm < 9.0) return std::clamp(0.9 - 0.5 * (r_mm - 8.0), 0.4, 0.9);
  return std::clamp(0.4 - 0.4 * (r_mm - 12.0), 0.0, 0.4);
}

struct GlideHand {
  explicit GlideHand(double (*density)(double)) {
    Load(density);
    Set(0.6);
  }

  void Load(double (*density)(double)) {
    const auto value = [density](int i, int j, int k) {
      // Corners that fix the range.
      if (i + j + k == 0) return 0.0;
      if (i + j + k == 3 * (kHeadEdge - 1)) return 1.0;
      return std::clamp(density((Vec3(i, j, k) - kHeadCentre).norm()), 0.0, 1.0);
    };
    volume = testing::MakeVolume(Vec3i::Constant(kHeadEdge), value, ++geometry_revision);
    scene.volume = volume;
  }

  void Set(double isovalue, FreeSide side = FreeSide::kBelow) {
    scene.isovalue = isovalue;
    scene.surface = MakeHapticSurface(*volume, AffineMap{}, isovalue, DecompositionMethod::kTpbcc,
                                      geometry_revision, side);
    scene.settings.free_side = side;
    ++scene.settings_revision;
  }

  TickSample Tick(const Vec3& from_centre) {
    TickInput input;
    input.stylus.p_DHip_mm = kHeadCentre + from_centre;
    const TickSample sample = computation.Run(scene, input);
    const Vec3 force_n(sample.force_n.data());
    greatest_step_n = std::max(greatest_step_n, (force_n - last_force_n).norm());
    last_force_n = force_n;
    faults += sample.mode == ProxyMode::kFault || sample.mode == ProxyMode::kInside;
    return sample;
  }
  TickSample Ticks(int count, const Vec3& from_centre) {
    for (int n = 1; n < count; ++n) Tick(from_centre);
    return Tick(from_centre);
  }

  std::shared_ptr<const VolumeSnapshot> volume;
  // Ticks in which the force may change as it likes, up to the first of the motion under test.
  void Settled() { greatest_step_n = 0.0; }

  std::uint64_t geometry_revision = 0;
  Scene scene;
  // Without the slew limit: the glide itself must not let the force jump. It does where it crosses
  // soft tissue that is the same all over.
  TickComputation computation{SafetyLimits{.max_slew_n_per_s = 1e9}};
  Vec3 last_force_n = Vec3::Zero();
  double greatest_step_n = 0.0;
  int faults = 0;
};

double RadiusOf(const TickSample& sample) {
  return (Vec3(sample.scp_h_mm.data()) - kHeadCentre).norm();
}

TEST(IsovalueGlide, TheSurfacePassesTheStylusAtItsSpeedBothWays) {
  GlideHand hand(Even);
  hand.Set(0.5);
  hand.Tick(Vec3(15, 0, 0));
  TickSample last = hand.Ticks(50, Vec3(8, 0.3, 0.2));
  hand.Settled();
  for (const double wanted : {0.4, 0.55}) {
    hand.Set(wanted);
    int ticks = 0;
    for (; last.isovalue != wanted && ticks < 1000; ++ticks) {
      const TickSample next = hand.Tick(Vec3(8, 0.3, 0.2));
      ASSERT_NEAR(std::abs(next.isovalue - last.isovalue), 50e-3 / 32.0, 4e-4) << ticks;
      ASSERT_LE(std::abs(RadiusOf(next) - RadiusOf(last)), 0.075) << ticks;
      ASSERT_NEAR(RadiusOf(next), EvenRadiusAt(next.isovalue), 0.1) << ticks;
      last = next;
      if (std::abs(last.isovalue - wanted) < 2e-3) break;
    }
    last = hand.Ticks(3, Vec3(8, 0.3, 0.2));
    EXPECT_EQ(last.isovalue, wanted);
    EXPECT_GT(ticks, 40);
    EXPECT_LT(ticks, 200);
  }
  EXPECT_EQ(hand.faults, 0);
  EXPECT_LE(hand.greatest_step_n, testing::kMaxStepN);
}

TEST(IsovalueGlide, AFreeStylusHasItAtOnce) {
  GlideHand hand(Head);
  hand.Ticks(10, Vec3(15, 0, 0));
  for (const double wanted : {0.2, 0.8, 0.5}) {
    hand.Set(wanted);
    EXPECT_EQ(hand.Tick(Vec3(15, 0, 0)).isovalue, wanted);
  }
}

TEST(IsovalueGlide, AFreeStylusThatWouldBeInsideIsCarriedOut) {
  GlideHand hand(Head);
  hand.Tick(Vec3(15, 0, 0));
  hand.Ticks(10, Vec3(10, 0, 0));  // within soft tissue, above bone
  hand.Set(0.2);
  TickSample sample = hand.Tick(Vec3(10, 0, 0));
  EXPECT_GT(sample.isovalue, 0.5);
  sample = hand.Ticks(2500, Vec3(10, 0, 0));
  EXPECT_EQ(sample.isovalue, 0.2);
  EXPECT_NEAR(RadiusOf(sample), 12.5, 0.2);
  EXPECT_EQ(sample.mode, ProxyMode::kConstrained);
}

TEST(IsovalueGlide, AnotherVolumeOrSideBeginsWithItsOwn) {
  GlideHand hand(Even);
  hand.Tick(Vec3(15, 0, 0));
  hand.Ticks(10, Vec3(6, 0, 0));
  hand.Load(Even);
  hand.Set(0.3);
  EXPECT_EQ(hand.Tick(Vec3(6, 0, 0)).isovalue, 0.3);
  hand.Set(0.5, FreeSide::kAbove);
  EXPECT_EQ(hand.Tick(Vec3(6, 0, 0)).isovalue, 0.5);
}

// A placement, even one that changes nothing, or another method.
TEST(IsovalueGlide, TheSameVolumeInAnotherPlaceGlidesOn) {
  GlideHand hand(Even);
  hand.Set(0.5);
  hand.Tick(Vec3(15, 0, 0));
  TickSample last = hand.Ticks(50, Vec3(8, 0.3, 0.2));
  hand.Settled();
  for (int n = 0; n < 40; ++n) {
    ++hand.geometry_revision;
    hand.Set(0.2);
    const TickSample next = hand.Tick(Vec3(8, 0.3, 0.2));
    ASSERT_NEAR(std::abs(next.isovalue - last.isovalue), 50e-3 / 32.0, 4e-4) << n;
    ASSERT_LE(std::abs(RadiusOf(next) - RadiusOf(last)), 0.075) << n;
    last = next;
  }
  EXPECT_EQ(hand.faults, 0);
  EXPECT_LE(hand.greatest_step_n, testing::kMaxStepN);
}

// What a hand meets that goes into the bone and out of the tissue.
struct Met {
  int touching = 0;
  int lost = 0;  // inside the object, where nothing is felt
  double greatest_n = 0.0;
};

// jumps: a new isovalue every 250 ticks or so, half of the time that of air.
Met GoInAndOut(bool jumps) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform;
  GlideHand hand(Head);
  hand.Set(0.02);
  Met met;
  Vec3 direction(1, 0, 0);
  for (int n = 0; n < 60'000; ++n) {
    if (jumps && uniform(random) < 0.004) {
      hand.Set(uniform(random) < 0.5 ? 0.02 : 0.2 + 0.65 * uniform(random));
    }
    direction += 0.01 * Vec3(uniform(random) - 0.5, uniform(random) - 0.5, uniform(random) - 0.5);
    direction.normalize();
    const double radius_mm = 10.5 + 3.5 * std::cos(n * 2e-3);
    const TickSample sample = hand.Tick(radius_mm * direction);
    met.touching += sample.contact;
    met.lost += sample.mode == ProxyMode::kInside;
    met.greatest_n = std::max(met.greatest_n, hand.last_force_n.norm());
    EXPECT_LE(sample.density, sample.isovalue + 1e-12) << n;
  }
  EXPECT_EQ(hand.faults, 0);
  return met;
}

TEST(IsovalueGlide, FromBoneToAirAndBackAtRandom) {
  const Met still = GoInAndOut(false), moved = GoInAndOut(true);
  std::printf("greatest force %.3f N, %.3f N without changes; %d ticks of contact, %d lost\n",
              moved.greatest_n, still.greatest_n, moved.touching, moved.lost);
  EXPECT_GT(moved.touching, 10'000);
  // The surface carries the stylus: hardly a tick is inside.
  EXPECT_LT(moved.lost, 60);
  EXPECT_LE(moved.greatest_n, 1.02 * still.greatest_n);
}

TEST(IsovalueGlide, ANewIsovalueThatBuriesIsNoFault) {
  GlideHand hand(Even);
  hand.Set(0.5);
  hand.Tick(Vec3(15, 0, 0));
  hand.Ticks(50, Vec3(0, 0, 0.5));
  hand.Set(0.0);  // all but a corner is material
  TickSample sample = hand.Ticks(5000, Vec3(0, 0, 0.5));
  EXPECT_EQ(sample.isovalue, 0.0);
  EXPECT_EQ(hand.faults, 0);
  hand.Set(0.9);
  sample = hand.Ticks(3000, Vec3(0, 0, 0.5));
  EXPECT_EQ(sample.isovalue, 0.9);
  EXPECT_EQ(sample.mode, ProxyMode::kFree);
}

TEST(IsovalueGlide, GoesOnFromAKeyframe) {
  GlideHand hand(Head);
  hand.Tick(Vec3(15, 0, 0));
  hand.Ticks(50, Vec3(7, 0, 0));
  hand.Set(0.1);
  hand.Ticks(100, Vec3(7, 0, 0));
  GlideHand other(Head);
  other.scene = hand.scene;
  ASSERT_TRUE(other.computation.Resume(hand.computation.Keyframe().view()));
  for (int n = 0; n < 2000; ++n) {
    const TickSample a = hand.Tick(Vec3(7, 0, 0)), b = other.Tick(Vec3(7, 0, 0));
    ASSERT_EQ(a.isovalue, b.isovalue) << n;
    ASSERT_EQ(a.force_n, b.force_n) << n;
    ASSERT_EQ(a.scp_h_mm, b.scp_h_mm) << n;
  }
  EXPECT_EQ(hand.Tick(Vec3(7, 0, 0)).isovalue, 0.1);
}

}  // namespace
}  // namespace palpate
