// The wireframe of H that the viewer computes is the daemon's H.
#include "client/view/drawing/haptic_patch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "server/lab/mesh.h"
#include "tests/support/made_volume.h"
#include "tests/support/view_volumes.h"

namespace palpate::view {
namespace {

using Points = std::vector<std::array<double, 3>>;

// Without order and repetition.
Points Distinct(const std::vector<Vec3>& points) {
  Points distinct;
  for (const Vec3& p : points) distinct.push_back({p.x(), p.y(), p.z()});
  std::sort(distinct.begin(), distinct.end());
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  return distinct;
}

// The viewer's copy of the daemon's volume, as the client library would hand it out.
ViewVolume CopyOf(const VolumeSnapshot& snapshot) {
  const auto voxels = testing::MakeVoxels(snapshot.size(), [&](int i, int j, int k) {
    return testing::ValueAt(snapshot, {i, j, k});
  });
  ViewVolume volume;
  volume.Take(testing::WholeVolume(voxels, {}));
  return volume;
}

// An isovalue in data units as the daemon's session makes a density of it.
double DensityOf(const VolumeSnapshot& volume, double isovalue) {
  double density = volume.Normalize(isovalue);
  while (volume.Denormalize(density) > isovalue) density = std::nextafter(density, -1.0);
  return density;
}

// The daemon's surface at an isovalue in data units. Vertices in I.
lab::SurfaceMesh MeshOf(const VolumeSnapshot& volume, double isovalue, DecompositionMethod method,
                        int refinement = 1) {
  const Lattice lattice(volume, refinement);
  lab::SurfaceMesh mesh = lab::ExtractSurface(lattice, DensityOf(volume, isovalue),
                                              lab::Compared(method), lab::PaddedCells(lattice));
  for (Vec3& vertex : mesh.vertices) vertex = lattice.ToVoxels(vertex);
  return mesh;
}

// levels: 0 for continuous values.
std::shared_ptr<const VolumeSnapshot> RandomVolume(const Vec3i& size, int levels, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-300.0, 1700.0);
  std::uniform_int_distribution<int> level(3, std::max(levels, 3));
  return testing::MakeVolume(size, [&](int, int, int) {
    return levels == 0 ? uniform(random) : static_cast<double>(level(random));
  });
}

TEST(HapticPatch, HasTheVerticesOfTheDaemonsSurface) {
  for (const int levels : {0, 5, 255}) {
    const auto snapshot = RandomVolume(Vec3i(11, 9, 17), levels, 5 + levels);
    const ViewVolume volume = CopyOf(*snapshot);
    const auto& metadata = snapshot->metadata();
    const double range = metadata.value_max - metadata.value_min;
    for (const double share : {0.0, 0.2, 0.5, 0.77}) {
      // With levels some of these tie with stored values.
      double isovalue = metadata.value_min + share * range;
      if (levels != 0) isovalue = std::floor(isovalue);
      for (const auto method : {DecompositionMethod::kBcc, DecompositionMethod::kTpbcc}) {
        for (const int refinement : {1, 2, 3}) {
          const auto mesh = MeshOf(*snapshot, isovalue, method, refinement);
          const auto patch = HapticPatch(volume, isovalue, method, refinement, Vec3(5, 4, 8), 40.0);
          ASSERT_GT(mesh.vertices.size(), 100u);
          ASSERT_EQ(patch.size() % 2, 0u);
          ASSERT_EQ(Distinct(patch), Distinct(mesh.vertices))
              << levels << ' ' << share << ' ' << NameOf(method) << ' ' << refinement;
        }
      }
    }
  }
}

// To the last bit, also where the daemon steps down from what it divides at first.
TEST(HapticPatch, RoundsTheIsovalueAsTheDaemonDoes) {
  const auto snapshot = RandomVolume(Vec3i(6, 6, 6), 0, 21);
  const ViewVolume volume = CopyOf(*snapshot);
  const auto method = DecompositionMethod::kTpbcc;
  std::mt19937 random(8);
  std::uniform_real_distribution<double> uniform(0.0, 1400.0);
  int stepped = 0;
  for (int n = 0; n < 100; ++n) {
    const double isovalue = uniform(random);
    stepped += DensityOf(*snapshot, isovalue) != snapshot->Normalize(isovalue);
    ASSERT_EQ(Distinct(HapticPatch(volume, isovalue, method, 1, Vec3(3, 3, 3), 9.0)),
              Distinct(MeshOf(*snapshot, isovalue, method).vertices));
  }
  EXPECT_GT(stepped, 10);
}

using Line = std::array<std::array<double, 3>, 2>;

Line LineOf(const Vec3& p, const Vec3& q) {
  Line line = {{{p.x(), p.y(), p.z()}, {q.x(), q.y(), q.z()}}};
  std::sort(line.begin(), line.end());
  return line;
}

// Unordered pairs in an order, repetitions kept.
std::vector<Line> LinesOf(const std::vector<Vec3>& points) {
  std::vector<Line> lines;
  for (std::size_t n = 0; n + 1 < points.size(); n += 2) {
    lines.push_back(LineOf(points[n], points[n + 1]));
  }
  std::sort(lines.begin(), lines.end());
  return lines;
}

TEST(HapticPatch, ConsistsOfEdgesOfTheSurface) {
  const auto snapshot = RandomVolume(Vec3i(8, 9, 10), 0, 77);
  const ViewVolume volume = CopyOf(*snapshot);
  const double isovalue = 600.0;
  const auto method = DecompositionMethod::kTpbcc;
  const auto mesh = MeshOf(*snapshot, isovalue, method);
  const auto lines = HapticPatch(volume, isovalue, method, 1, Vec3(4, 4, 4), 40.0);
  std::vector<Line> edges;
  for (const auto& t : mesh.triangles) {
    for (int n = 0; n < 3; ++n) {
      edges.push_back(LineOf(mesh.vertices[t[n]], mesh.vertices[t[(n + 1) % 3]]));
    }
  }
  std::sort(edges.begin(), edges.end());
  for (const Line& line : LinesOf(lines)) {
    EXPECT_TRUE(std::binary_search(edges.begin(), edges.end(), line));
  }
  // Each edge but the diagonals once: those of a closed surface are 1.5 per triangle.
  EXPECT_GT(lines.size(), 2 * mesh.triangles.size());
  EXPECT_LE(lines.size(), 3 * mesh.triangles.size());
}

// Without repetition, and how many there were.
std::pair<std::vector<Line>, std::size_t> DistinctLines(const std::vector<Vec3>& points) {
  std::vector<Line> lines = LinesOf(points);
  const std::size_t all = lines.size();
  lines.erase(std::unique(lines.begin(), lines.end()), lines.end());
  return {lines, all - lines.size()};
}

// What neighbouring cells share is there once, and nothing is left out for it: a patch of
// one cell has no neighbours.
TEST(HapticPatch, HasTheLinesThatCellsShareOnce) {
  for (const int levels : {0, 4}) {
    const auto snapshot = RandomVolume(Vec3i(7, 8, 9), levels, 31 + levels);
    const ViewVolume volume = CopyOf(*snapshot);
    const double isovalue = levels == 0 ? 650.0 : 3.5;
    for (const auto method : {DecompositionMethod::kBcc, DecompositionMethod::kTpbcc}) {
      std::vector<Vec3> alone;
      std::size_t repeated_in_cells = 0;
      for (int n = 0; n < 5 * 5 * 5; ++n) {
        const Vec3 middle = Vec3(n / 25, n / 5 % 5, n % 5) + Vec3::Constant(0.5);
        const auto of_cell = HapticPatch(volume, isovalue, method, 1, middle, 0.25);
        alone.insert(alone.end(), of_cell.begin(), of_cell.end());
        // Where densities tie, lines of two faces may fall together, and are tiny.
        repeated_in_cells += DistinctLines(of_cell).second;
      }
      const auto [expected, shared] = DistinctLines(alone);
      const auto patch = HapticPatch(volume, isovalue, method, 1, Vec3::Constant(2.5), 2.25);
      const auto [seen, repeated] = DistinctLines(patch);
      ASSERT_TRUE(seen == expected) << levels << ' ' << NameOf(method);
      EXPECT_LE(repeated, levels == 0 ? 0 : repeated_in_cells);
      EXPECT_GT(shared, expected.size() / 10);
    }
  }
}

TEST(HapticPatch, HoldsTheCellsOfItsBoxAndNoOthers) {
  const auto snapshot = RandomVolume(Vec3i(20, 20, 20), 0, 9);
  const ViewVolume volume = CopyOf(*snapshot);
  const auto method = DecompositionMethod::kTpbcc;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> anywhere(-6.0, 26.0);
  for (int n = 0; n < 50; ++n) {
    const Vec3 center(anywhere(random), anywhere(random), anywhere(random));
    const Vec3i first = (center.array() - 2.5).floor().matrix().cast<int>().cwiseMax(-1);
    const Vec3i end =
        (center.array() + 2.5).floor().matrix().cast<int>().cwiseMin(19) + Vec3i::Ones();
    const auto patch = HapticPatch(volume, 700.0, method, 1, center, 2.5);
    if ((first.array() >= end.array()).any()) {
      EXPECT_TRUE(patch.empty());
      continue;
    }
    const auto mesh = lab::ExtractSurface(*snapshot, DensityOf(*snapshot, 700.0),
                                          lab::Compared(method), {first, end});
    ASSERT_EQ(Distinct(patch), Distinct(mesh.vertices)) << center.transpose();
  }
}

TEST(HapticPatch, IsEmptyWhereThereIsNothing) {
  const auto method = DecompositionMethod::kTpbcc;
  EXPECT_TRUE(HapticPatch(ViewVolume(), 0.5, method, 1, Vec3::Zero(), 5.0).empty());
  const ViewVolume volume = CopyOf(*RandomVolume(Vec3i(8, 8, 8), 0, 1));
  const double infinite = std::numeric_limits<double>::infinity();
  for (const double bad : {std::nan(""), infinite, 1e300, -1e300}) {
    EXPECT_TRUE(HapticPatch(volume, 700.0, method, 1, Vec3(bad, 0, 0), 5.0).empty());
  }
  EXPECT_TRUE(HapticPatch(volume, 700.0, method, 1, Vec3::Zero(), -1.0).empty());
  EXPECT_TRUE(HapticPatch(volume, 700.0, method, 1, Vec3::Zero(), std::nan("")).empty());
  EXPECT_TRUE(HapticPatch(volume, 1e9, method, 1, Vec3(4, 4, 4), 5.0).empty());
  EXPECT_FALSE(HapticPatch(volume, 700.0, method, 1, Vec3(4, 4, 4), 1e300).empty());
}

}  // namespace
}  // namespace palpate::view
