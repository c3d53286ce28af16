// Sub-cells: the values that they share, and the topology of H made of them.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "server/lab/mesh.h"
#include "server/lab/mesh_statistics.h"
#include "server/lab/trilinear_topology.h"
#include "tests/support/made_volume.h"

namespace palpate::lab {
namespace {

// levels: 0 for continuous values.
std::shared_ptr<const VolumeSnapshot> RandomGrid(std::mt19937_64& random, int levels) {
  std::uniform_real_distribution<double> uniform;
  return testing::MakeVolume(Vec3i::Constant(5), [&](int, int, int) {
    return levels == 0 ? uniform(random) : std::floor(uniform(random) * levels);
  });
}

// By F's own formula, in cells of the voxels.
double ValueOfF(const VolumeSnapshot& volume, const Vec3& p_I) {
  const Vec3i cell = p_I.array().floor().cast<int>().cwiseMin(volume.size().array() - 1);
  return Trilinear(volume.StoredCell(cell)).Value(p_I - cell.cast<double>());
}

TEST(Lattice, AVertexHasTheSameBitsInAllItsCellsAndTheValueOfF) {
  std::mt19937_64 random(3);
  for (const int refinement : {2, 3, 4}) {
    for (const int levels : {0, 256, 2}) {
      const auto volume = RandomGrid(random, levels);
      const Lattice lattice(*volume, refinement);
      std::map<std::array<int, 3>, double> values;
      const Vec3i count = lattice.size() + Vec3i::Ones();
      for (int n = 0; n < count.prod(); ++n) {
        const Vec3i cell =
            Vec3i(n % count.x(), n / count.x() % count.y(), n / (count.x() * count.y())) -
            Vec3i::Ones();
        ASSERT_TRUE(lattice.HasCell(cell));
        const CellDensities d = lattice.ResolvedCell(cell);
        for (int v = 0; v < 8; ++v) {
          const auto& o = kCornerOffset[v];
          const Vec3i at = cell + Vec3i(o[0], o[1], o[2]);
          const auto known = values.try_emplace({at.x(), at.y(), at.z()}, d[v]).first;
          ASSERT_EQ(known->second, d[v]);
          const double f = ValueOfF(*volume, lattice.ToVoxels(at.cast<double>()));
          ASSERT_NEAR(d[v], f, 1.1 * kTieStep);
          ASSERT_LT(d[v], f - 0.2 * kTieStep);  // a value equal to τ is free
          for (int other = 0; other < v; ++other) ASSERT_NE(d[v], d[other]);
        }
      }
      EXPECT_FALSE(lattice.HasCell(lattice.size()));
      EXPECT_EQ(lattice.FromVoxels(Vec3(-1.0, 0.0, 5.0)),
                Vec3(-1.0, refinement - 1.0, lattice.size().x()));
    }
  }
}

TEST(RefinedMesh, HasTheTopologyOfTheTrilinearSurfaceAlsoWhereValuesTie) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform;
  for (const int levels : {0, 256, 4, 3, 2}) {
    for (int n = 0; n < 40; ++n) {
      const auto volume = RandomGrid(random, levels);
      // Of tied grids also where interpolated values tie with τ.
      const double isovalue =
          levels > 0 && levels < 256 && n % 2 == 0
              ? std::floor(uniform(random) * 8.0 * (levels - 1)) / (8.0 * (levels - 1))
              : uniform(random);
      const MeshStatistics coarse = MeasureMesh(
          ExtractSurface(*volume, isovalue, ComparedMethod::kTpbcc, PaddedCells(*volume)));
      for (const int refinement : {2, 3, 4}) {
        const Lattice lattice(*volume, refinement);
        const MeshStatistics s = MeasureMesh(
            ExtractSurface(lattice, isovalue, ComparedMethod::kTpbcc, PaddedCells(lattice)));
        ASSERT_EQ(s.boundary_edges + s.misoriented_edges, 0);
        ASSERT_TRUE(s.IsManifold());
        ASSERT_EQ(s.components, coarse.components) << levels << " " << n << " " << refinement;
        ASSERT_EQ(s.euler,
                  CountTrilinearTopology(*volume, isovalue, PaddedCells(*volume)).surface());
      }
    }
  }
}

}  // namespace
}  // namespace palpate::lab
