// Snapshots of OpenVDB grids, and the builtin volumes.
#include "server/volume/snapshot/snapshot.h"
#include "server/volume/snapshot/openvdb_grids.h"
#include "server/volume/snapshot/snapshot_builder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "common/error/error.h"
#include "server/volume/load/builtin.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/voxels.h"

namespace palpate {
namespace {

using testing::Refusal;

TEST(Snapshot, ReadsWhatTheGridHolds) {
  const BuiltinVolume bumps = MakeBuiltin("builtin:bumps:40");
  const auto snapshot = MakeSnapshot(bumps.grid, bumps.metadata, 3);
  EXPECT_EQ(snapshot->revision(), 3u);
  const auto accessor = bumps.grid->getConstAccessor();
  testing::ForEachVoxel(Vec3i(41, 41, 41), [&](const Vec3i& n) {
    const Vec3i cell = n - Vec3i::Ones();
    const CellDensities stored = snapshot->StoredCell(cell);
    const CellDensities resolved = snapshot->ResolvedCell(cell);
    for (int v = 0; v < 8; ++v) {
      const auto& o = kCornerOffset[v];
      const Vec3i p = cell + Vec3i(o[0], o[1], o[2]);
      const bool inside = (p.array() >= 0).all() && (p.array() < 40).all();
      const double value = inside ? accessor.getValue(openvdb::Coord(p.x(), p.y(), p.z())) : 0.0;
      ASSERT_EQ(stored[v], snapshot->Normalize(value));
      ASSERT_EQ(resolved[v], snapshot->ResolvedVertex(p));
      ASSERT_LT(resolved[v], stored[v]);
      ASSERT_GE(resolved[v], stored[v] - kTieStep);
    }
  });
}

TEST(Snapshot, ACellOutsideIsBackground) {
  const BuiltinVolume sphere = MakeBuiltin("builtin:sphere:16");
  const auto snapshot = MakeSnapshot(sphere.grid, sphere.metadata, 1);
  EXPECT_FALSE(snapshot->HasCell(Vec3i(-2, 0, 0)));
  EXPECT_TRUE(snapshot->HasCell(Vec3i(-1, 0, 15)));
  EXPECT_FALSE(snapshot->HasCell(Vec3i(0, 0, 16)));
  for (double d : snapshot->StoredCell(Vec3i(1000, -5, 3))) EXPECT_EQ(d, 0.0);
}

TEST(Builtin, CylinderFallsLinearlyFromItsAxis) {
  const BuiltinVolume cylinder = MakeBuiltin("builtin:cylinder", Vec3(0.5, 0.5, 2.0));
  EXPECT_EQ(cylinder.metadata.size, Vec3i(100, 100, 30));
  EXPECT_EQ(cylinder.metadata.spacing_mm, Vec3(0.5, 0.5, 2.0));
  const auto accessor = cylinder.grid->getConstAccessor();
  EXPECT_NEAR(accessor.getValue(openvdb::Coord(49, 49, 0)), 1.0 - std::sqrt(0.5) / 50.0, 1e-6);
  EXPECT_NEAR(accessor.getValue(openvdb::Coord(74, 49, 29)), 1.0 - std::hypot(24.5, 0.5) / 50.0,
              1e-6);
  EXPECT_EQ(accessor.getValue(openvdb::Coord(0, 0, 7)), 0.0f);
}

TEST(Builtin, GyroidAndSphereFollowTheirFormulas) {
  const BuiltinVolume gyroid = MakeBuiltin("builtin:gyroid:32");
  const double k = 2.0 * std::numbers::pi / 8.0;
  const double s = (std::sin(3 * k) * std::cos(5 * k) + std::sin(5 * k) * std::cos(9 * k) +
                    std::sin(9 * k) * std::cos(3 * k)) /
                   (1.5 * k);
  EXPECT_NEAR(gyroid.grid->getConstAccessor().getValue(openvdb::Coord(3, 5, 9)),
              std::clamp(0.5 - s / 8.0, 0.0, 1.0), 1e-6);
  const BuiltinVolume sphere = MakeBuiltin("builtin:sphere");
  EXPECT_EQ(sphere.metadata.size, Vec3i::Constant(128));
  EXPECT_NEAR(sphere.grid->getConstAccessor().getValue(openvdb::Coord(20, 63, 63)),
              0.5 - (std::sqrt(43.5 * 43.5 + 0.5) - 44.8) / 8.0, 1e-6);
}

TEST(Builtin, RefusesWhatIsNoneOrTooLargeAndCanBeCancelled) {
  for (const char* source :
       {"builtin:", "builtin:cube", "builtin:sphere:", "builtin:sphere:7", "builtin:sphere:1e9",
        "builtin:sphere:-3", "builtin:cylinder:64", "builtin:bumps:12x"}) {
    EXPECT_EQ(Refusal([&] { MakeBuiltin(source); }), ErrorKind::kInvalidArgument) << source;
  }
  for (const Vec3& spacing : {Vec3(0, 1, 1), Vec3(-1, 1, 1), Vec3(1e300, 1, 1), Vec3(1, 1e-300, 1),
                              Vec3(1, 1, std::nan(""))}) {
    EXPECT_EQ(Refusal([&] { MakeBuiltin("builtin:sphere:8", spacing); }),
              ErrorKind::kInvalidArgument)
        << spacing.transpose();
  }
  EXPECT_EQ(Refusal([] { MakeBuiltin("builtin:sphere:100", Vec3::Ones(), 999'999); }),
            ErrorKind::kTooLarge);
  EXPECT_EQ(
      Refusal([] { MakeBuiltin("builtin:gyroid:64", Vec3::Ones(), 1 << 20, [] { return true; }); }),
      ErrorKind::kCancelled);
}

}  // namespace
}  // namespace palpate
