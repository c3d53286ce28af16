// SCP_V lies on the trilinear isosurface, next to SCP_H.
#include "server/haptics/visual_proxy.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "server/haptics/proxy.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

using testing::MakeVolume;

struct Tally {
  int contacts = 0, found = 0;
};

// Presses the proxy into the surface from all sides. Each SCP_V that is found is on V.
Tally Press(const VolumeSnapshot& volume, double isovalue, const AffineMap& X_DI) {
  const HapticSurface surface =
      MakeHapticSurface(volume, X_DI, isovalue, DecompositionMethod::kTpbcc, 1);
  const Vec3 centre = (volume.size().cast<double>() - Vec3::Ones()) / 2.0;
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  Tally tally;
  double worst_voxels = 0.0;  // distance from V, by density over gradient
  Proxy proxy;
  CellCache cache;
  Vec3 direction(1, 0, 0);
  StepProxy(surface, X_DI.Apply(centre + 30.0 * direction), 1e9, proxy, cache);
  for (int n = 0; n < 10000; ++n) {
    direction =
        (direction + 0.02 * Vec3(normal(random), normal(random), normal(random))).normalized();
    const ProxyStep step =
        StepProxy(surface, X_DI.Apply(centre + 8.0 * direction), 1e9, proxy, cache);
    if (!proxy.on_surface()) continue;
    ++tally.contacts;
    const VisualProxy visual = FindVisualProxy(surface, proxy.place, step.normal_D, cache);
    if (!visual.found) continue;
    ++tally.found;
    const Vec3 p_I = surface.X_ID.Apply(visual.p_DV_mm);
    const Vec3i cell = p_I.array().floor().cast<int>();
    const Trilinear density(volume.StoredCell(cell));
    const Vec3 within = p_I - cell.cast<double>();
    worst_voxels = std::max(
        worst_voxels, std::abs(density.Value(within) - isovalue) / density.Gradient(within).norm());
    EXPECT_NEAR(visual.normal_D.norm(), 1.0, 1e-9);
  }
  std::printf("contacts %d, SCP_V found %d, worst %.2e voxel\n", tally.contacts, tally.found,
              worst_voxels);
  EXPECT_GT(tally.contacts, 9000);
  EXPECT_LT(worst_voxels, 1e-6);
  return tally;
}

TEST(VisualProxy, LiesOnTheTrilinearSurfaceOfASphere) {
  constexpr int kEdge = 32;
  const Vec3 centre = Vec3::Constant((kEdge - 1) / 2.0);
  const auto volume = MakeVolume(Vec3i::Constant(kEdge), [&](int i, int j, int k) {
    return std::clamp(0.5 - ((Vec3(i, j, k) - centre).norm() - 11.0) / 8.0, 0.0, 1.0);
  });
  Mat3 uneven;
  uneven << 0.4, 0.1, 0.0, 0.0, -0.5, 0.0, 0.05, 0.0, 0.9;
  for (const AffineMap& X_DI :
       {AffineMap{Mat3::Identity() * 0.3, Vec3::Zero()}, AffineMap{uneven, Vec3(1.0, 2.0, 3.0)}}) {
    const Tally tally = Press(*volume, volume->Normalize(0.5), X_DI);
    EXPECT_EQ(tally.found, tally.contacts);
  }
}

TEST(VisualProxy, FollowsWavesAcrossCells) {
  // Waves of 3 voxels: H and V differ, and the line leaves the cell often.
  const auto volume = MakeVolume(Vec3i::Constant(32), [&](int i, int j, int k) {
    const double r = (Vec3(i, j, k) - Vec3::Constant(15.5)).norm();
    return 0.5 - (r - 11.0 - 0.7 * std::sin(2.1 * i) * std::sin(2.1 * j) * std::sin(2.1 * k)) / 8.0;
  });
  const Tally tally =
      Press(*volume, volume->Normalize(0.5), {Mat3::Identity() * 0.3, Vec3::Zero()});
  EXPECT_GE(tally.found, tally.contacts * 999 / 1000);
}

}  // namespace
}  // namespace palpate
