// The promise of the decompositions: H has the topology of the trilinear surface. Held against
// published grids, and over whole volumes against a count that knows no decomposition.
// unit/isosurface_test.cpp has the single cells.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "server/lab/load_volume.h"
#include "server/lab/mesh.h"
#include "server/lab/mesh_statistics.h"
#include "server/lab/trilinear_topology.h"
#include "tests/support/data_folder.h"
#include "tests/support/made_volume.h"
#include "tests/support/places.h"

namespace palpate::lab {
namespace {

constexpr auto kTpbcc = DecompositionMethod::kTpbcc;
// Rows without comments, split at commas and blanks.
std::vector<std::vector<std::string>> ReadGridRows(const std::filesystem::path& path) {
  std::vector<std::vector<std::string>> rows;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line);
    rows.emplace_back();
    for (std::string field; fields >> field;) rows.back().push_back(field);
  }
  return rows;
}

// id, b0, total genus, then the 27 inner values of a 5x5x5 grid, x fastest, whose
// border is +1.
std::shared_ptr<const VolumeSnapshot> MakeClosedGrid(const std::vector<std::string>& row) {
  return testing::MakeVolume(Vec3i::Constant(5), [&](int i, int j, int k) {
    if (i % 4 == 0 || j % 4 == 0 || k % 4 == 0) return 1.0;
    return std::stod(row[static_cast<std::size_t>(3 + (i - 1) + 3 * (j - 1) + 9 * (k - 1))]);
  });
}

TEST(LabTopology, PublishedClosedGrids) {
  const auto path = std::filesystem::path(test::kSharedCells) / "published_closed.txt";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const auto rows = ReadGridRows(path);
  ASSERT_GT(rows.size(), 3000u);
  const CellRange range{Vec3i::Zero(), Vec3i::Constant(4)};
  std::map<DecompositionMethod, int> wrong;
  int miscounted = 0;
  for (const auto& row : rows) {
    const auto grid = MakeClosedGrid(row);
    const double isovalue = grid->Normalize(0.0);
    const std::int64_t components = std::stoi(row[1]), genus = std::stoi(row[2]);
    const auto morse = CountTrilinearTopology(*grid, isovalue, range);
    miscounted += morse.surface() != 2 * (components - genus);
    for (const auto method :
         {kTpbcc, DecompositionMethod::kBcc, DecompositionMethod::kTpbccPublished}) {
      const MeshStatistics s = MeasureMesh(ExtractSurface(*grid, isovalue, method, range));
      const bool closed = s.boundary_edges == 0 && s.IsManifold();
      wrong[method] += !closed || s.components != components || s.genus() != genus;
    }
  }
  std::printf("%zu grids, wrong: tpbcc %d, bcc %d, published %d\n", rows.size(), wrong[kTpbcc],
              wrong[DecompositionMethod::kBcc], wrong[DecompositionMethod::kTpbccPublished]);
  EXPECT_EQ(wrong[kTpbcc], 0);
  EXPECT_GT(wrong[DecompositionMethod::kBcc], 0);  // the control
  EXPECT_EQ(miscounted, 0);
}

class WholeVolumeTest : public ::testing::TestWithParam<testing::KnownSurface> {};

TEST_P(WholeVolumeTest, HasTheTopologyOfTheTrilinearSurface) {
  const testing::KnownSurface& param = GetParam();
  const std::string source = testing::PlaceOf(param.source);
  if (source.empty()) GTEST_SKIP() << param.source << testing::kMissing;
  const auto volume = LoadVolume(source, test::kPalpateImport);
  const MeshStatistics s =
      MeasureMesh(ExtractSurface(*volume, param.isovalue, kTpbcc, PaddedCells(*volume)));
  const MorseCount morse = CountTrilinearTopology(*volume, param.isovalue, PaddedCells(*volume));
  EXPECT_GT(s.triangles, 0);
  EXPECT_EQ(s.boundary_edges, 0);
  EXPECT_EQ(s.non_manifold_edges, 0);
  EXPECT_EQ(s.non_manifold_vertices, 0);
  EXPECT_EQ(s.misoriented_edges, 0);
  EXPECT_EQ(s.euler, morse.surface());
}

INSTANTIATE_TEST_SUITE_P(Volumes, WholeVolumeTest, ::testing::ValuesIn(testing::kPaperSurfaces),
                         testing::kNameOf);
INSTANTIATE_TEST_SUITE_P(Builtin, WholeVolumeTest,
                         ::testing::Values(testing::KnownSurface{"gyroid_50", "builtin:gyroid:128",
                                                                 0.5}),
                         testing::kNameOf);

}  // namespace
}  // namespace palpate::lab
