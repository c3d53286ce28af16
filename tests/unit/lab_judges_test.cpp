// What judges replays: distances, densities, ways and rest, held against cases that
// can be told by hand, and against brute force. Every judge must also be able to
// condemn.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "server/lab/mesh.h"
#include "server/lab/proxy_judges.h"
#include "server/lab/replay_judge.h"
#include "server/lab/trajectory.h"
#include "server/lab/triangle_grid.h"
#include "tests/support/made_volume.h"

namespace palpate::lab {
namespace {

constexpr auto kTpbcc = DecompositionMethod::kTpbcc;

HapticSurface SurfaceOf(const VolumeSnapshot& volume, double isovalue,
                        FreeSide side = FreeSide::kBelow) {
  return MakeHapticSurface(volume, volume.metadata().WorldFromIndex(), isovalue, kTpbcc, 1, side);
}

// A wall of material at x = 4, one voxel thick, in a box of 9 voxels; `hole`: with
// a way through in its middle.
std::shared_ptr<const VolumeSnapshot> MakeWall(bool hole = false) {
  return testing::MakeVolume(Vec3i::Constant(9), [=](int i, int j, int k) {
    return i == 4 && !(hole && j == 4 && k == 4) ? 1.0 : 0.0;
  });
}

TEST(LabTriangleDistance, IsThatToFacesEdgesAndCorners) {
  const Vec3 a(0, 0, 0), b(2, 0, 0), c(0, 2, 0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(0.5, 0.5, 3), a, b, c), 9.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(1, -2, 0), a, b, c), 4.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(2, 2, 0), a, b, c), 2.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(-3, -4, 0), a, b, c), 25.0);
  // Degenerate ones are segments and points.
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(1, 1, 0), a, b, b), 1.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTriangle(Vec3(1, 1, 0), a, a, a), 2.0);
}

TEST(LabTriangleDistance, IsZeroInsideATetrahedron) {
  const std::array<Vec3, 4> corner = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)};
  EXPECT_EQ(SquaredDistanceToTetrahedron(Vec3(0.2, 0.2, 0.2), corner), 0.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTetrahedron(Vec3(1, 1, 1), corner), 4.0 / 3.0);
  EXPECT_DOUBLE_EQ(SquaredDistanceToTetrahedron(Vec3(0.2, 0.2, -0.5), corner), 0.25);
}

// As thin as free space between voxels that are nearly equal.
TEST(LabTriangleDistance, NothingIsInsideANeedle) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto vector = [&] { return Vec3(uniform(random), uniform(random), uniform(random)); };
  for (int n = 0; n < 10'000; ++n) {
    const Vec3 a = vector(), b = vector(), p = vector();
    const std::array<Vec3, 4> needle = {a, a + 1e-8 * vector(), a + 1e-8 * vector(), b};
    ASSERT_NEAR(std::sqrt(SquaredDistanceToTetrahedron(p, needle)),
                std::sqrt(SquaredDistanceToTriangle(p, a, b, b)), 1e-7);
  }
}

// Far from the origin, rounding turns a thin face. A corner that is cut off stays outside.
TEST(LabTriangleDistance, ACornerThatIsCutOffIsOutside) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-0.01, 0.01);
  const auto vector = [&] { return Vec3(uniform(random), uniform(random), uniform(random)); };
  for (int n = 0; n < 10'000; ++n) {
    const Vec3 corner = Vec3(3, -7, 11) + vector();
    const Vec3 along = vector(), to_b = vector(), to_c = vector();
    const std::array<Vec3, 4> rest = {corner + 3e-9 * along, corner + 3e-9 * to_b, corner + to_b,
                                      corner + to_c};
    ASSERT_GT(SquaredDistanceToTetrahedron(corner, rest), 0.0) << n;
  }
}

TEST(LabTriangleGrid, IsTheNearestOfAllTriangles) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-6.0, 18.0), value(0.0, 1.0);
  const auto volume =
      testing::MakeVolume(Vec3i(12, 11, 9), [&](int, int, int) { return value(random); });
  const SurfaceMesh mesh = ExtractSurface(*volume, 0.7, Compared(kTpbcc), PaddedCells(*volume));
  ASSERT_GT(mesh.triangles.size(), 1000u);
  AffineMap X_DI;
  X_DI.linear << 0.3, 0.1, 0.0, 0.0, 2.0, 0.4, 0.2, 0.0, 0.9;
  X_DI.translation = Vec3(7, -3, 11);
  const TriangleGrid grid(mesh, X_DI);
  for (int n = 0; n < 300; ++n) {
    const Vec3 p_mm = X_DI.Apply(Vec3(uniform(random), uniform(random), uniform(random)));
    double nearest = 1e300;
    for (const auto& t : mesh.triangles) {
      nearest = std::min(nearest, SquaredDistanceToTriangle(p_mm, X_DI.Apply(mesh.vertices[t[0]]),
                                                            X_DI.Apply(mesh.vertices[t[1]]),
                                                            X_DI.Apply(mesh.vertices[t[2]])));
    }
    EXPECT_EQ(grid.Distance(p_mm, 1e6), std::sqrt(nearest));
    EXPECT_DOUBLE_EQ(grid.Distance(p_mm, 0.3), std::min(0.3, std::sqrt(nearest)));
  }
}

TEST(LabFreshCells, DensityIsThatOfThePiecewiseLinearField) {
  const auto volume =
      testing::MakeVolume(Vec3i(5, 6, 7), [](int i, int j, int k) { return i + 2 * j + 3 * k; });
  FreshCells cells(SurfaceOf(*volume, 0.5));
  const auto density = [&](const Vec3& p_I) { return cells.HoldersOf(p_I).Density(); };
  for (const Vec3& p :
       {Vec3(1.25, 2.5, 3.125), Vec3(2, 3, 1), Vec3(0.5, 4, 5.9), Vec3(3.5, 1, 2)}) {
    EXPECT_NEAR(volume->Denormalize(density(p)), p.dot(Vec3(1, 2, 3)), 1e-6) << p.transpose();
  }
  EXPECT_EQ(density(Vec3(-1.5, 2, 2)), 0.0);
  EXPECT_EQ(density(Vec3(1e9, 2, 2)), 0.0);
  // A lattice vertex is held by tetrahedra of eight cells: in each by that at the corner and by
  // those at the corner's three edges.
  EXPECT_EQ(cells.HoldersOf(Vec3(2, 3, 1)).tetrahedra.size(), 8 * 4u);
}

TEST(LabFreePath, EndsAtAWallAndGoesThroughAHole) {
  const Vec3 before(3, 4, 4), behind(5, 4, 4);
  for (bool hole : {false, true}) {
    const auto volume = MakeWall(hole);
    FreshCells cells(SurfaceOf(*volume, 0.5));
    EXPECT_EQ(FindFreePath(cells, before, Vec3(2.2, 4.3, 3.9), Vec3(2, 4, 4)), FreePath::kFound);
    EXPECT_EQ(FindFreePath(cells, before, behind, behind),
              hole ? FreePath::kFound : FreePath::kNone);
  }
}

TEST(LabFreePath, GoesRoundAWallOnlyWhereTheBallLets) {
  const auto volume = MakeWall();
  FreshCells cells(SurfaceOf(*volume, 0.5));
  const Vec3 before(3, 4, 4), behind(5, 4, 4), far_away(30, 4, 4);
  EXPECT_EQ(FindFreePath(cells, before, behind, far_away), FreePath::kFound);
  EXPECT_EQ(FindFreePath(cells, before, far_away, far_away), FreePath::kFound);
  EXPECT_EQ(FindFreePath(cells, before, behind, far_away, 3), FreePath::kUnchecked);
}

TEST(LabFreePath, OnTheOtherSideIsThroughTheMaterial) {
  const auto volume = MakeWall();
  FreshCells cells(SurfaceOf(*volume, 0.5, FreeSide::kAbove));
  EXPECT_EQ(FindFreePath(cells, Vec3(4, 2, 2), Vec3(4, 6, 6), Vec3(4, 6, 6)), FreePath::kFound);
  EXPECT_EQ(FindFreePath(cells, Vec3(4, 2, 2), Vec3(5.5, 6, 6), Vec3(5.5, 6, 6)), FreePath::kNone);
  EXPECT_EQ(FindFreePath(cells, Vec3(4, 2, 2), Vec3(30, 6, 6), Vec3(30, 6, 6)), FreePath::kNone);
}

void ExpectSound(const Verdict& v) {
  EXPECT_EQ(v.fall_throughs, 0);
  EXPECT_EQ(v.sticks, 0);
  EXPECT_EQ(v.unchecked_ticks, 0);
  EXPECT_EQ(v.excess_off_minimum_ticks, 0);
  EXPECT_EQ(v.scp_v_off_ticks, 0);
}

// Ticks of a real proxy that has met the wall, to be tampered with.
class LabJudge : public ::testing::Test {
 protected:
  Verdict Judged() const {
    const TriangleGrid triangles(
        ExtractSurface(*volume_, 0.5, Compared(kTpbcc), PaddedCells(*volume_)), AffineMap{});
    return JudgeReplay(surface_, settings_, triangles, ticks_);
  }

  std::shared_ptr<const VolumeSnapshot> volume_ = MakeWall();
  HapticSurface surface_ = SurfaceOf(*volume_, 0.5);
  HapticSettings settings_;
  std::vector<ReplayTick> ticks_ =
      Replay(surface_, settings_, {Vec3(3, 4, 4), Vec3(3.2, 4, 4), Vec3(3.8, 4, 4)}, 2);
};

TEST_F(LabJudge, FindsNothingWrongWithTheProxy) {
  const Verdict v = Judged();
  ExpectSound(v);
  EXPECT_EQ(v.contact_ticks, 1);
  EXPECT_EQ(v.excess_force_ticks, 0);
  EXPECT_EQ(v.scp_v_ticks, 1);
  EXPECT_NEAR(v.density[2], 0.5, 1e-12);
}

TEST_F(LabJudge, CondemnsAProxyInTheWall) {
  ticks_[2].output.proxy.p_DH_mm.x() += 1e-8;
  EXPECT_EQ(Judged().fall_throughs, 1);
  ticks_[2].output.proxy.mode = ProxyMode::kEjecting;
  EXPECT_EQ(Judged().fall_throughs, 0);
  EXPECT_EQ(Judged().ejecting_ticks, 1);
}

TEST_F(LabJudge, CondemnsAProxyThroughTheWall) {
  ticks_[2].p_DHip_mm = ticks_[2].output.p_DHip_mm = ticks_[2].output.proxy.p_DH_mm = Vec3(5, 4, 4);
  ticks_[2].output.spring_D_n = Vec3::Zero();
  EXPECT_EQ(Judged().fall_throughs, 1);
  EXPECT_EQ(Judged().sticks, 0);
  // As if it had popped out: the side is another one, and on it there it is inside.
  ticks_[2].output.free_side = FreeSide::kAbove;
  EXPECT_EQ(Judged().fall_throughs, 1);
}

TEST_F(LabJudge, CondemnsAProxyThatSticks) {
  HapticOutput& output = ticks_[2].output;
  output.p_DHip_mm.y() += 1e-5 * (output.p_DHip_mm - output.proxy.p_DH_mm).norm();
  EXPECT_EQ(Judged().sticks, 0);  // by less than the tolerance
  output.p_DHip_mm.y() += 1e-4 * (output.p_DHip_mm - output.proxy.p_DH_mm).norm();
  EXPECT_EQ(Judged().sticks, 1);
  output.p_DHip_mm.y() += 0.1;
  EXPECT_EQ(Judged().sticks, 1);
  output.proxy.capped = true;
  EXPECT_EQ(Judged().sticks, 0);
  EXPECT_EQ(Judged().iteration_cap_hits, 1);
  output.proxy.capped = false;
  settings_.dynamic_friction = 0.1;
  EXPECT_EQ(Judged().sticks, std::nullopt);
  // Free, and not at the HIP.
  settings_.dynamic_friction = 0.0;
  ticks_[1].output.proxy.p_DH_mm.x() = 3.1;
  EXPECT_EQ(Judged().sticks, 2);
}

TEST(LabRest, PositionsAreRoundedWhereTheyAreFarAway) {
  const auto volume = MakeWall();
  AffineMap X_DI;
  X_DI.linear *= 1e-3;
  FreshCells cells(MakeHapticSurface(*volume, X_DI, 0.5, kTpbcc, 1));
  const Vec3 hip_mm(3e4, 1, 1);
  EXPECT_TRUE(IsLocalMinimum(cells, Vec3(std::nextafter(3e4, 0.0), 1, 1), hip_mm));
  EXPECT_FALSE(IsLocalMinimum(cells, Vec3(3e4 - 1e-8, 1, 1), hip_mm));
}

TEST_F(LabJudge, CondemnsForceThatTheSurfaceDoesNotExplain) {
  // 0.3 mm deep: 0.15 N are right, and up to 0.35 N pass.
  ticks_[2].output.spring_D_n = Vec3(-0.349, 0, 0);
  EXPECT_EQ(Judged().excess_force_ticks, 0);
  ticks_[2].output.spring_D_n = Vec3(-0.351, 0, 0);
  EXPECT_EQ(Judged().excess_force_ticks, 1);
  EXPECT_EQ(Judged().excess_off_minimum_ticks, 0);
  ticks_[2].output.p_DHip_mm.y() += 0.1;
  EXPECT_EQ(Judged().excess_off_minimum_ticks, 1);
}

TEST_F(LabJudge, CondemnsAVisualProxyOffV) {
  ticks_[2].visual.p_DV_mm.x() += 1e-5;
  EXPECT_EQ(Judged().scp_v_off_ticks, 1);
}

TEST_F(LabJudge, MeasuresHowFarTheVisualProxyIsAndHowTheForceTurns) {
  EXPECT_NEAR(Judged().scp_hv_voxels, 0.0, 1e-7);  // but for the tie step
  EXPECT_NEAR(Judged().force_angle_deg, 0.0, 1e-6);
  ticks_[2].visual.p_DV_mm.y() += 0.25;
  ticks_[2].visual.normal_D = Vec3(-std::sqrt(0.75), 0.5, 0);
  EXPECT_NEAR(Judged().scp_hv_voxels, 0.25, 1e-7);
  EXPECT_NEAR(Judged().force_angle_deg, 30.0, 1e-9);
}

// With pops the proxy is on either side, and never in the other.
TEST(LabAttack, FindsNoFaultWithPops) {
  std::mt19937_64 random(5);
  const auto volume = testing::MakeVolume(
      Vec3i::Constant(12), [&](int, int, int) { return static_cast<double>(random() % 256); });
  const HapticSurface surface = SurfaceOf(*volume, 0.49);
  const HapticSettings settings{.pop_force_n = 0.4};
  const auto hips_mm = MakeTrajectory(*volume, {.kind = TrajectoryKind::kRandom, .ticks = 8'000});
  const std::vector<ReplayTick> ticks = Replay(surface, settings, hips_mm, 1);
  const TriangleGrid triangles(
      ExtractSurface(*volume, 0.49, Compared(kTpbcc), PaddedCells(*volume)), surface.X_DI);
  const Verdict v = JudgeReplay(surface, settings, triangles, ticks);
  int pops = 0, above = 0;
  for (const ReplayTick& tick : ticks) {
    pops += tick.output.popped;
    above += tick.output.free_side == FreeSide::kAbove;
  }
  EXPECT_GT(pops, 100);
  EXPECT_GT(above, 200);
  EXPECT_EQ(v.fall_throughs, 0);
  EXPECT_EQ(v.sticks, 0);
}

// A slide just below the surface: whole volumes are in integration/lab_volumes_test.cpp.
TEST(LabSlide, IsFeltWithoutFault) {
  const auto volume = palpate::testing::Gyroid();
  const HapticSurface surface = SurfaceOf(*volume, 0.5);
  const auto hips_mm = MakeTrajectory(*volume, {.ticks = 20'000});
  const TriangleGrid triangles(ExtractSurface(*volume, 0.5, Compared(kTpbcc), PaddedCells(*volume)),
                               surface.X_DI);
  const Verdict v = JudgeReplay(surface, {}, triangles, Replay(surface, {}, hips_mm, 1));
  ExpectSound(v);
  EXPECT_EQ(v.ejecting_ticks, 0);
  EXPECT_EQ(v.iteration_cap_hits, 0);
  EXPECT_GT(v.contact_ticks, 18'000);
}

}  // namespace
}  // namespace palpate::lab
