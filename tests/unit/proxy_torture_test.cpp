// The proxy under random attack. Every tick is judged from positions alone: where the proxy
// is, whether it can have come there, and whether it may rest there.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "server/haptics/proxy.h"
#include "server/lab/fresh_cells.h"
#include "server/volume/snapshot/ball_field.h"
#include "tests/support/made_volume.h"
#include "tests/support/path_judge.h"
#include "tests/support/scaled.h"
#include "tests/support/torture.h"

namespace palpate {
namespace {

using testing::ApproachLeft;
using testing::HasRange;
using testing::kDensityTolerance;
using testing::MakeVolume;
using testing::MoveHip;
using testing::PathJudge;
using testing::RandomSurface;
using testing::RandomVolume;

constexpr double kFarMm = 1e9;  // an eject limit that never bites

struct Torture {
  long moves = 0, steps = 0, fall_throughs = 0, unrested = 0, capped = 0, contacts = 0,
       misplaced = 0, jumps = 0;

  void ExpectSound() const {
    EXPECT_GT(contacts, steps / 20);
    for (const long fault : {fall_throughs, misplaced, jumps, unrested, capped})
      EXPECT_EQ(fault, 0);
  }
  void Print(int levels) const {
    std::printf(
        "levels %3d: %ld steps, %ld moves, %ld in contact, fall-throughs %ld, misplaced %ld, "
        "jumps %ld, not at rest %ld, capped %ld\n",
        levels, steps, moves, contacts, fall_throughs, misplaced, jumps, unrested, capped);
  }
};

// `origin_I`: around which the HIP moves.
void TortureGrid(std::mt19937_64& random, const VolumeSnapshot& volume, int refinement, int steps,
                 Torture& result, const Vec3i& origin_I = Vec3i::Zero()) {
  if (!HasRange(volume)) return;
  const HapticSurface surface = RandomSurface(random, volume, refinement, origin_I + Vec3i::Ones());
  const auto at = [&](const Vec3& p_I) {
    return surface.X_DI.Apply(p_I + origin_I.cast<double>());
  };
  static CellCache cache;
  cache = CellCache();
  PathJudge judge(surface);
  Proxy proxy;
  Vec3 hip_I = Vec3::Constant(-3.0);
  Vec3 last_mm = StepProxy(surface, at(hip_I), kFarMm, proxy, cache).p_DH_mm;
  bool has_last = !proxy.buried;
  for (int n = 0; n < steps; ++n) {
    MoveHip(random, hip_I);
    const Vec3 hip_mm = at(hip_I);
    const ProxyStep step = StepProxy(surface, hip_mm, kFarMm, proxy, cache);
    ++result.steps;
    result.moves += step.moves;
    result.capped += step.capped;
    result.contacts += step.mode == ProxyMode::kConstrained;
    // From above τ, the stylus is out of reach of the surface where it starts.
    if (proxy.buried) {
      has_last = false;
      continue;
    }
    const bool outside = proxy.place.kind == Place::Kind::kOutside;
    result.fall_throughs += !outside && surface.sign() * step.density > surface.isovalue;
    const double density = judge.HoldersAt(step.p_DH_mm).Density();
    // Also where it is no number, in a gap between cells.
    result.misplaced += !(judge.cells().Inside(density) <= kDensityTolerance);
    // One that was buried is put at the HIP.
    result.misplaced += has_last && step.p_DH_mm != PlacePosition(surface, proxy.place, cache);
    result.jumps += has_last && !judge.MayHaveCome(last_mm, step.p_DH_mm, hip_mm);
    result.unrested += !step.capped && ApproachLeft(judge, step.p_DH_mm, hip_mm) > 0.0;
    last_mm = step.p_DH_mm;
    has_last = true;
  }
}

class ProxyTorture : public ::testing::TestWithParam<int> {};

TEST_P(ProxyTorture, NeverFallsThroughAndAlwaysRests) {
  const int refinement = GetParam();
  // The judge takes its time on fine lattices.
  const int steps = refinement <= 2 ? 3000 : 1500;
  const int grids = std::max(6, test::Scaled(refinement == 1 ? 15 : 6));
  std::mt19937_64 random(6);
  for (int levels : {0, 256, 16, 4, 2, 1}) {
    Torture result;
    for (int n = 0; n < grids; ++n) {
      TortureGrid(random, *RandomVolume(random, levels), refinement, steps, result);
    }
    result.Print(levels);
    result.ExpectSound();
  }
}

// Plateaus as large as the ball, at values of the volume.
TEST_P(ProxyTorture, TheFieldOfABallIsAVolumeLikeOthers) {
  const int grids = std::max(3, test::Scaled(6));
  std::mt19937_64 random(8);
  for (int levels : {0, 16, 2}) {
    Torture result;
    for (int n = 0; n < grids; ++n) {
      const BallField field(
          {.radius_mm = 0.5 + 2.5 * static_cast<double>(n) / grids, .is_least = n % 3 == 2});
      const auto volume = field.Of(*RandomVolume(random, levels), 1, [](double) {});
      TortureGrid(random, *volume, GetParam(), 1500, result, field.margin());
    }
    result.Print(levels);
    result.ExpectSound();
  }
}

// τ and the side change under the proxy, again and again: it is moved out, or buried,
// and never left inside.
struct Ejections {
  long steps = 0, ejecting = 0, buried = 0, inside = 0;
};

void ChangeGrid(std::mt19937_64& random, int levels, int refinement, int steps, Ejections& result) {
  std::uniform_real_distribution<double> uniform;
  const auto volume = RandomVolume(random, levels);
  if (!HasRange(*volume)) return;
  const auto surface_of = [&](double isovalue, FreeSide side) {
    return MakeHapticSurface(*volume, AffineMap{}, isovalue, DecompositionMethod::kTpbcc, 1, side,
                             refinement);
  };
  static CellCache cache;
  cache = CellCache();
  Proxy proxy;
  Vec3 hip = Vec3::Constant(2.0);
  double isovalue = 0.5;
  FreeSide side = FreeSide::kBelow;
  // The densities are those of every τ and either side.
  lab::FreshCells cells(surface_of(isovalue, side));
  for (int n = 0; n < steps; ++n) {
    if (uniform(random) < 0.2) isovalue = uniform(random);
    if (uniform(random) < 0.05) {
      isovalue = volume->StoredCell(Vec3i(1, 2, 1))[static_cast<std::size_t>(uniform(random) * 8)];
    }
    if (uniform(random) < 0.1) {
      side = side == FreeSide::kBelow ? FreeSide::kAbove : FreeSide::kBelow;
    }
    const Vec3 r(uniform(random), uniform(random), uniform(random));
    hip = uniform(random) < 0.05 ? Vec3(6.0 * r - Vec3::Ones())
                                 : Vec3(hip + 0.4 * (r - Vec3::Constant(0.5)));
    hip = hip.cwiseMax(-1.0).cwiseMin(5.0);
    const HapticSurface surface = surface_of(isovalue, side);
    const ProxyStep step = StepProxy(surface, hip, 4.0, proxy, cache);
    ++result.steps;
    result.ejecting += step.mode == ProxyMode::kEjecting;
    result.buried += proxy.buried;
    if (proxy.buried) continue;
    const bool outside = proxy.place.kind == Place::Kind::kOutside;
    const double density = cells.HoldersOf(surface.X_LD.Apply(step.p_DH_mm)).Density();
    result.inside += !(surface.sign() * density - surface.isovalue <= kDensityTolerance);
    result.inside += !outside && surface.sign() * step.density > surface.isovalue;
  }
}

TEST_P(ProxyTorture, ChangesOfIsovalueAndSideNeverLeaveItInside) {
  const int grids = std::max(10, test::Scaled(GetParam() == 1 ? 30 : 10));
  std::mt19937_64 random(7);
  for (int levels : {2, 3, 4, 16, 0}) {
    Ejections result;
    for (int n = 0; n < grids; ++n) ChangeGrid(random, levels, GetParam(), 1000, result);
    std::printf("levels %2d: %ld steps, %ld ejecting, %ld buried, %ld inside\n", levels,
                result.steps, result.ejecting, result.buried, result.inside);
    EXPECT_GT(result.ejecting, result.steps / 100);
    EXPECT_EQ(result.inside, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Refinements, ProxyTorture, ::testing::Values(1, 2, 3, 4));

// --- The judge itself, on ways that no proxy may take

// Material from x = 2 to x = 6 within 9³ voxels; `hole`: with a way through along x.
std::shared_ptr<const VolumeSnapshot> Slab(bool hole = false) {
  return MakeVolume(Vec3i::Constant(9), [=](int i, int j, int k) {
    const bool solid = i >= 2 && i <= 6 && !(hole && j == 4 && k == 4);
    return solid ? 1.0 : 0.0;
  });
}

HapticSurface SurfaceOf(const VolumeSnapshot& volume, FreeSide side = FreeSide::kBelow) {
  const Mat3 mirror = Vec3(1.0, -1.0, 1.0).asDiagonal();
  return MakeHapticSurface(volume, {0.1 * mirror, Vec3(3.0, -7.0, 11.0)}, 0.5,
                           DecompositionMethod::kTpbcc, 1, side);
}

// Positions in voxels.
bool MayHaveCome(const HapticSurface& surface, const Vec3& from, const Vec3& to, const Vec3& hip) {
  return PathJudge(surface).MayHaveCome(surface.X_DI.Apply(from), surface.X_DI.Apply(to),
                                        surface.X_DI.Apply(hip));
}

TEST(PathJudge, AJumpThroughTheWholeVolumeIsNoWay) {
  const auto slab = Slab(), with_hole = Slab(true);
  const Vec3 before(-2.5, 4, 4), behind(10.5, 4, 4);
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*slab), before, behind, behind));
  EXPECT_TRUE(MayHaveCome(SurfaceOf(*with_hole), before, behind, behind));
  // Beside the hole: it is held before it comes there.
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*with_hole), Vec3(-2.5, 2, 2), behind, Vec3(10.5, 2, 2)));
  // The slab ends with the lattice: past it all is free.
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*slab), Vec3(-2.5, 4, 9.5), Vec3(10.5, 4, 9.5), Vec3(10.5, 4, 9.5)));
  // Met near its end, and slid along: each step on this way is nearer to the HIP.
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*slab), Vec3(-2.5, 4, 7), Vec3(10.5, 4, 9.5), Vec3(10.5, 4, 9.5)));
}

TEST(PathJudge, AJumpThroughAWallWithinTheVolumeIsNoWay) {
  const auto wall = MakeVolume(Vec3i::Constant(9), [](int i, int, int) { return i == 4; });
  const HapticSurface surface = SurfaceOf(*wall);
  EXPECT_FALSE(MayHaveCome(surface, Vec3(3, 4, 4), Vec3(5, 4, 4), Vec3(5, 4, 4)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(3.5, 4, 4), Vec3(4.5, 4, 4), Vec3(4.4, 4, 4)));
  EXPECT_TRUE(MayHaveCome(surface, Vec3(3, 4, 4), Vec3(3.5, 4.1, 4), Vec3(4, 4.1, 4)));
  // On the other side the wall is what is free.
  EXPECT_FALSE(MayHaveCome(SurfaceOf(*wall, FreeSide::kAbove), Vec3(4, 4, 4), Vec3(9.5, 4, 4),
                           Vec3(9.5, 4, 4)));
  EXPECT_TRUE(
      MayHaveCome(SurfaceOf(*wall, FreeSide::kAbove), Vec3(4, 2, 2), Vec3(4, 6, 6), Vec3(4, 6, 6)));
}

TEST(PathJudge, AWayThatLeadsAwayFromTheHipIsNone) {
  const auto slab = Slab();
  const HapticSurface surface = SurfaceOf(*slab);
  // Held at x = 1.5, and found on another place of the same face, farther away.
  EXPECT_TRUE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(1.5, 4, 4), Vec3(3, 4, 4)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(1.5, 7, 7), Vec3(3, 4, 4)));
  // In free space nothing but the HIP is where it goes.
  EXPECT_TRUE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(0, 7, 7), Vec3(0, 7, 7)));
  EXPECT_FALSE(MayHaveCome(surface, Vec3(0, 4, 4), Vec3(0, 6, 6), Vec3(0, 7, 7)));
}

}  // namespace
}  // namespace palpate
