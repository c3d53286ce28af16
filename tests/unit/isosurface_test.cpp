// The topology of decomposed cells, saddles, and ties. decomposition_test.cpp has the geometry.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <ostream>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "common/isosurface/decomposition.h"
#include "common/isosurface/saddles.h"
#include "common/isosurface/ties.h"
#include "server/lab/cell_topology.h"
#include "tests/support/places.h"

namespace palpate {
namespace {

using lab::CellTopology;

// Normalises over the cell's own range, the only one there is, and resolves
// ties as a volume would.
CellDensities Resolve(const CellDensities& raw, double& isovalue) {
  const auto [lo, hi] = std::minmax_element(raw.begin(), raw.end());
  const double min = *lo, range = *hi > *lo ? *hi - *lo : 1.0;
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    d[v] = ResolvedDensity((raw[v] - min) / range, o[0], o[1], o[2]);
  }
  isovalue = (isovalue - min) / range;
  return d;
}

// A file of cells: densities, τ, and what the trilinear surface is like.
struct CellFile {
  const char* name;
  const char* folder;
  std::size_t least_rows;
  int first;                         // column of d0; τ follows d7
  int above, below, surface, euler;  // columns; 0: not given
};

void PrintTo(const CellFile& file, std::ostream* out) { *out << file.name; }

struct LabelledCell {
  CellDensities d;
  double isovalue;
  CellTopology expected;
};

std::vector<LabelledCell> ReadCells(const CellFile& cells, const std::filesystem::path& path) {
  std::ifstream file(path);
  std::vector<LabelledCell> read;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream in(line);
    const std::vector<std::string> row{std::istream_iterator<std::string>(in), {}};
    const auto count = [&](int column) {
      return column > 0 ? std::stoi(row.at(static_cast<std::size_t>(column))) : 0;
    };
    LabelledCell& cell = read.emplace_back();
    for (int v = 0; v < 8; ++v)
      cell.d[v] = std::stod(row.at(static_cast<std::size_t>(cells.first + v)));
    cell.isovalue = std::stod(row.at(static_cast<std::size_t>(cells.first + 8)));
    cell.d = Resolve(cell.d, cell.isovalue);
    cell.expected = {count(cells.above), count(cells.below), count(cells.surface),
                     count(cells.euler)};
  }
  return read;
}

class Topology : public ::testing::TestWithParam<CellFile> {};

TEST_P(Topology, EqualsTheLabels) {
  const CellFile& file = GetParam();
  const auto path = std::filesystem::path(file.folder) / file.name;
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is missing";
  const std::vector<LabelledCell> cells = ReadCells(file, path);
  ASSERT_GE(cells.size(), file.least_rows);
  for (const auto method : {DecompositionMethod::kTpbcc, DecompositionMethod::kBcc}) {
    std::size_t wrong = 0;
    for (const LabelledCell& cell : cells) {
      CellTopology found = lab::CountCellTopology(Decompose(cell.d, method), cell.isovalue);
      if (file.above == 0) found.above = found.below = 0;
      wrong += found != cell.expected;
    }
    if (method == DecompositionMethod::kTpbcc) {
      EXPECT_EQ(wrong, 0u);
    } else {
      EXPECT_GT(wrong, cells.size() / 250);  // the control: BCC does not keep topology
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Of, Topology,
    ::testing::Values(CellFile{"labelled.csv", test::kCells, 25'000, 0, 11, 12, 13, 14},
                      CellFile{"ties.csv", test::kCells, 12'000, 0, 9, 10, 11, 12},
                      CellFile{"published_cells.csv", test::kSharedCells, 3'000, 1, 12, 13, 14, 10},
                      CellFile{"named_cells.csv", test::kSharedCells, 14, 1, 0, 0, 10, 11}),
    [](const auto& file) {
      const std::string name = file.param.name;
      return name.substr(0, name.find('.'));
    });

TEST(FaceSaddle, IsWhereTheBilinearGradientVanishes) {
  const FaceSaddle saddle = FindFaceSaddle(0.0, 1.0, 0.2, 0.6);
  ASSERT_TRUE(saddle.exists);
  EXPECT_TRUE(saddle.p_and_s_low);
  const double b = saddle.b, c = saddle.c;
  EXPECT_NEAR((1 - c) * (1.0 - 0.0) + c * (0.2 - 0.6), 0.0, 1e-15);
  EXPECT_NEAR((1 - b) * (0.6 - 0.0) + b * (0.2 - 1.0), 0.0, 1e-15);
  EXPECT_NEAR(saddle.density.value(), (0.0 * 0.2 - 1.0 * 0.6) / (0.0 + 0.2 - 1.0 - 0.6), 1e-15);
  EXPECT_FALSE(FindFaceSaddle(0.0, 1.0, 2.0, 0.5).exists);
}

TEST(FaceSaddle, SurvivesTinyAndHugeDifferences) {
  EXPECT_TRUE(FindFaceSaddle(0.0, 1e-300, 0.0, 1e-300).exists);
  EXPECT_TRUE(FindFaceSaddle(0.0, 1e300, 0.0, 1e300).exists);
  const FaceSaddle near_corner = FindFaceSaddle(0.5, 0.5 + 1e-16, 0.0, 1.0);
  EXPECT_TRUE(near_corner.exists);
  EXPECT_EQ(near_corner.density.base, 0.5);
}

TEST(BodySaddle, IsAZeroOfTheGradientInsideTheCell) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform;
  int found = 0;
  for (int n = 0; n < 20000; ++n) {
    CellDensities d;
    for (double& x : d) x = uniform(random);
    const BodySaddles saddles = FindBodySaddles(d);
    const Trilinear f(d);
    for (int s = 0; s < saddles.count; ++s, ++found) {
      EXPECT_LT(f.Gradient(saddles.saddle[s].position).norm(), 1e-9);
      EXPECT_NEAR(f.Value(saddles.saddle[s].position), saddles.saddle[s].density, 1e-12);
    }
  }
  EXPECT_GT(found, 1000);
}

TEST(BodySaddle, IsNotSeenWhereNearTiesHideThatThereIsNone) {
  // Values 1, 0, 0, 0, 0, ½, 0, 0, resolved. In exact arithmetic the discriminant
  // is negative.
  const CellDensities d = {0.99999999617766178,     -8.620123074952933e-09,
                           -2.9222852891094914e-09, -4.9488091001328044e-09,
                           -4.6774414832872173e-09, 0.49999999541575002,
                           -9.43030974151151e-09,   -2.6636804575942143e-09};
  EXPECT_EQ(FindBodySaddles(d).count, 0);
}

TEST(Ties, LowerOnlyAndByLessThanTheStep) {
  std::set<double> seen;
  for (int i = -1; i < 20; ++i) {
    for (int j = -1; j < 20; ++j) {
      for (int k = -1; k < 20; ++k) {
        const double h = TieHash(i, j, k);
        EXPECT_GE(h, 0.25);
        EXPECT_LT(h, 1.0);
        EXPECT_LT(ResolvedDensity(0.5, i, j, k), 0.5);
        seen.insert(ResolvedDensity(0.5, i, j, k));
      }
    }
  }
  EXPECT_EQ(seen.size(), 21u * 21u * 21u);
}

}  // namespace
}  // namespace palpate
