// The promise of the decompositions: H has the topology of the trilinear surface.
// Held against published cells and grids, and over whole volumes against a count
// that knows no decomposition.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <ostream>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/lab/load_volume.h"
#include "server/lab/mesh.h"
#include "server/lab/mesh_statistics.h"
#include "server/lab/trilinear_topology.h"
#include "tests/support/cell_topology.h"
#include "tests/support/data_folder.h"
#include "tests/support/made_volume.h"
#include "tests/support/places.h"

namespace palpate::lab {
namespace {

using testing::CellTopology;

constexpr auto kTpbcc = DecompositionMethod::kTpbcc;
constexpr std::array kAllMethods = {DecompositionMethod::kBcc, DecompositionMethod::kTptd,
                                    DecompositionMethod::kTpbccPublished, kTpbcc};

std::filesystem::path CellsFile(const char* name) {
  return std::filesystem::path(test::kSharedCells) / name;
}

// Rows without comments, split at commas and blanks.
std::vector<std::vector<std::string>> ReadRows(const std::filesystem::path& path) {
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

void PrintCounts(const char* what, DecompositionMethod method, int wrong, std::size_t total) {
  const std::string_view name = MethodName(method);
  std::printf("%-20s %-16.*s %5d wrong of %zu\n", what, static_cast<int>(name.size()), name.data(),
              wrong, total);
}

struct LabelledCell {
  CellDensities density;  // normalised over the cell's range, ties resolved
  double isovalue;
};

LabelledCell ParseCell(const std::vector<std::string>& row) {
  CellDensities d;
  for (int v = 0; v < 8; ++v) d[v] = std::stod(row[1 + v]);
  const auto [min, max] = std::minmax_element(d.begin(), d.end());
  const double low = *min, range = *max - *min;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = ResolvedDensity((d[v] - low) / range, o[0], o[1], o[2]);
  }
  return {d, (std::stod(row[9]) - low) / range};
}

TEST(LabTopology, PublishedCells) {
  const auto path = CellsFile("published_cells.csv");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const auto rows = ReadRows(path);
  ASSERT_GT(rows.size(), 3000u);
  for (DecompositionMethod method : kAllMethods) {
    int wrong = 0;
    for (const auto& row : rows) {
      const LabelledCell cell = ParseCell(row);
      const CellTopology expected{std::stoi(row[12]), std::stoi(row[13]), std::stoi(row[14]),
                                  std::stoi(row[10])};
      wrong += testing::TopologyOf(Decompose(cell.density, method), cell.isovalue) != expected;
    }
    PrintCounts("published_cells.csv", method, wrong, rows.size());
    if (method == kTpbcc) {
      EXPECT_EQ(wrong, 0);
    }
  }
}

TEST(LabTopology, NamedCells) {
  const auto path = CellsFile("named_cells.csv");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const auto rows = ReadRows(path);
  ASSERT_EQ(rows.size(), 14u);
  for (DecompositionMethod method : kAllMethods) {
    int wrong = 0;
    for (const auto& row : rows) {
      const LabelledCell cell = ParseCell(row);
      const CellTopology found =
          testing::TopologyOf(Decompose(cell.density, method), cell.isovalue);
      wrong += found.surface != std::stoi(row[10]) || found.euler != std::stoi(row[11]);
    }
    PrintCounts("named_cells.csv", method, wrong, rows.size());
    if (method == kTpbcc) {
      EXPECT_EQ(wrong, 0);
    }
  }
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
  const auto path = CellsFile("published_closed.txt");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const auto rows = ReadRows(path);
  ASSERT_GT(rows.size(), 3000u);
  const CellRange range{Vec3i::Zero(), Vec3i::Constant(4)};
  std::array<int, kAllMethods.size()> wrong{};
  int open = 0, miscounted = 0;
  for (const auto& row : rows) {
    const auto grid = MakeClosedGrid(row);
    const double isovalue = grid->Normalize(0.0);
    const std::int64_t components = std::stoi(row[1]), genus = std::stoi(row[2]);
    const auto morse = CountTrilinearTopology(*grid, isovalue, range);
    miscounted += morse.surface() != 2 * (components - genus);
    for (std::size_t m = 0; m < kAllMethods.size(); ++m) {
      const MeshStatistics s = MeasureMesh(ExtractSurface(*grid, isovalue, kAllMethods[m], range));
      const bool closed = s.boundary_edges == 0 && s.IsManifold();
      wrong[m] += !closed || s.components != components || s.genus() != genus;
      if (kAllMethods[m] == kTpbcc) open += !closed;
    }
  }
  for (std::size_t m = 0; m < kAllMethods.size(); ++m) {
    PrintCounts("published_closed.txt", kAllMethods[m], wrong[m], rows.size());
    if (kAllMethods[m] == kTpbcc) {
      EXPECT_EQ(wrong[m], 0);
    }
  }
  EXPECT_EQ(open, 0);
  EXPECT_EQ(miscounted, 0);
}

struct WholeVolume {
  const char* name;
  const char* source;  // in the data folder, or builtin
  double isovalue;     // normalised
};

void PrintTo(const WholeVolume& volume, std::ostream* out) { *out << volume.name; }

class Stopwatch {
 public:
  double Lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(start_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

class WholeVolumeTest : public ::testing::TestWithParam<WholeVolume> {};

TEST_P(WholeVolumeTest, HasTheTopologyOfTheTrilinearSurface) {
  const WholeVolume& param = GetParam();
  std::string source = param.source;
  if (!source.starts_with("builtin:")) {
    source = (testing::DataFolder() / source).string();
    if (!std::filesystem::exists(source)) {
      GTEST_SKIP() << source << " is missing: see PALPATE_DATA_DIR";
    }
  }
  const auto volume = LoadVolume(source, test::kPalpateImport);
  Stopwatch watch;
  const SurfaceMesh mesh = ExtractSurface(*volume, param.isovalue, kTpbcc, PaddedCells(*volume));
  const double mesh_s = watch.Lap();
  const MeshStatistics s = MeasureMesh(mesh);
  const double measure_s = watch.Lap();
  const MorseCount morse = CountTrilinearTopology(*volume, param.isovalue, PaddedCells(*volume));
  const double morse_s = watch.Lap();
  std::printf(
      "%-10s %9zu vertices, %9zu triangles, %7d components, Euler %7d (trilinear %7d, from %d "
      "vertices, %d face and %d body saddles), boundary %d, non-manifold %d edges and %d vertices; "
      "%.2f s (counted in %.2f s, trilinear %.2f s)\n",
      param.name, mesh.vertices.size(), mesh.triangles.size(), static_cast<int>(s.components),
      static_cast<int>(s.euler), static_cast<int>(morse.surface()),
      static_cast<int>(morse.vertices), static_cast<int>(morse.face_saddles),
      static_cast<int>(morse.body_saddles), static_cast<int>(s.boundary_edges),
      static_cast<int>(s.non_manifold_edges), static_cast<int>(s.non_manifold_vertices), mesh_s,
      measure_s, morse_s);

  EXPECT_GT(s.triangles, 0);
  EXPECT_EQ(s.boundary_edges, 0);
  EXPECT_EQ(s.non_manifold_edges, 0);
  EXPECT_EQ(s.non_manifold_vertices, 0);
  EXPECT_EQ(s.misoriented_edges, 0);
  EXPECT_EQ(s.euler, morse.surface());

  // Without the padding H is cut at the border of the volume, and only there.
  const CellRange inner{Vec3i::Zero(), volume->size() - Vec3i::Ones()};
  const MeshStatistics cut = MeasureMesh(ExtractSurface(*volume, param.isovalue, kTpbcc, inner));
  EXPECT_EQ(cut.boundary_edges_off_border, 0);
  EXPECT_EQ(cut.non_manifold_edges, 0);
}

INSTANTIATE_TEST_SUITE_P(
    Volumes, WholeVolumeTest,
    ::testing::Values(
        WholeVolume{"daisy_02", "paper/daisy_192x180x168_uint8.nhdr", 0.02},
        WholeVolume{"daisy_24", "paper/daisy_192x180x168_uint8.nhdr", 0.24},
        WholeVolume{"orange_22", "paper/orange_256x256x64_uint8.nhdr", 0.22},
        WholeVolume{"lobster_16", "paper/lobster_301x324x56_uint8.nhdr", 0.16},
        WholeVolume{"head_17", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.17},
        WholeVolume{"head_33", "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd", 0.33},
        WholeVolume{"gyroid_50", "builtin:gyroid:128", 0.5}),
    [](const auto& volume) { return std::string(volume.param.name); });

}  // namespace
}  // namespace palpate::lab
