// Every decomposition is a triangulation of its cell, on any input; the topology of decomposed
// cells, saddles, and ties.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <ostream>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "common/isosurface/cell.h"
#include "common/isosurface/decomposition.h"
#include "common/isosurface/placement.h"
#include "common/isosurface/saddles.h"
#include "server/lab/cell_topology.h"
#include "server/lab/compared_method.h"
#include "tests/support/places.h"
#include "tests/support/random_cell.h"
#include "tests/support/scaled.h"
#include "tests/support/trilinear_cell.h"

namespace palpate {
namespace {

using testing::CellKind, testing::kCellKinds, testing::RandomCell;

using Triangle = std::array<std::uint8_t, 3>;

std::map<Triangle, int> CountTriangles(const TetrahedralComplex& complex) {
  std::map<Triangle, int> count;
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    auto v = complex.vertices[t];
    std::sort(v.begin(), v.end());
    for (int left_out = 0; left_out < 4; ++left_out) {
      Triangle triangle;
      for (int n = 0, m = 0; n < 4; ++n) {
        if (n != left_out) triangle[m++] = v[n];
      }
      ++count[triangle];
    }
  }
  return count;
}

std::set<Triangle> ExpectedOnFace(int face, bool split_around_vertex) {
  std::set<Triangle> triangles;
  const auto& k = kFaceCorners[face];
  const auto add = [&](int a, int b, int c) {
    Triangle triangle = {static_cast<std::uint8_t>(a), static_cast<std::uint8_t>(b),
                         static_cast<std::uint8_t>(c)};
    std::sort(triangle.begin(), triangle.end());
    triangles.insert(triangle);
  };
  if (split_around_vertex) {
    for (int n = 0; n < 4; ++n) add(kFirstFaceVertex + face, k[n], k[(n + 1) % 4]);
  } else {
    add(k[0], k[1], k[2]);
    add(k[0], k[2], k[3]);
  }
  return triangles;
}

// Every triangle is shared by two tetrahedra, or lies on a face, where the
// triangles are those that both neighbours expect.
void ExpectMatched(const Decomposition& cell, const CellSaddles& saddles,
                   lab::ComparedMethod method) {
  std::array<std::set<Triangle>, 6> on_face;
  for (const auto& [triangle, count] : CountTriangles(cell.complex)) {
    const unsigned faces =
        kVertexFaces[triangle[0]] & kVertexFaces[triangle[1]] & kVertexFaces[triangle[2]];
    ASSERT_EQ(count, faces ? 1 : 2);
    for (int face = 0; face < 6; ++face) {
      if (faces >> face & 1) on_face[face].insert(triangle);
    }
  }
  for (int face = 0; face < 6; ++face) {
    const bool around = method != lab::ComparedMethod::kTptd || saddles.face[face].exists;
    ASSERT_EQ(on_face[face], ExpectedOnFace(face, around));
  }
}

double AbsoluteVolumes(const Decomposition& cell) {
  double sum = 0.0;
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    const auto& v = cell.complex.vertices[t];
    const Vec3& o = cell.position[v[0]];
    sum +=
        std::abs(
            (cell.position[v[1]] - o).cross(cell.position[v[2]] - o).dot(cell.position[v[3]] - o)) /
        6.0;
  }
  return sum;
}

// Smallest altitude of any tetrahedron, in cell edges.
double SmallestAltitude(const Decomposition& cell) {
  double smallest = 1.0;
  for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
    const auto& v = cell.complex.vertices[t];
    for (int apex = 0; apex < 4; ++apex) {
      const Vec3& a = cell.position[v[(apex + 1) % 4]];
      const Vec3 normal = (cell.position[v[(apex + 2) % 4]] - a)
                              .cross(cell.position[v[(apex + 3) % 4]] - a)
                              .normalized();
      smallest = std::min(smallest, std::abs(normal.dot(cell.position[v[apex]] - a)));
    }
  }
  return smallest;
}

const int kCellsOfAKind = test::Scaled(5000);

class Decompositions : public ::testing::TestWithParam<lab::ComparedMethod> {};

// Matched triangles and a boundary that is the cube's make the signed volumes sum
// to 1; then no tetrahedron is inverted if and only if the absolute ones do too.
TEST_P(Decompositions, FillTheCell) {
  const lab::ComparedMethod method = GetParam();
  for (const CellKind kind : kCellKinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    std::mt19937_64 random(13);
    double worst = 0.0, altitude = 1.0;
    int checked = 0;
    for (int n = 0; n < kCellsOfAKind; ++n) {
      const CellDensities d = RandomCell(kind, random);
      const CellSaddles saddles(d);
      // The diamond of six saddles need not be star-shaped.
      if (method == lab::ComparedMethod::kTptd && saddles.count == 6) continue;
      const Decomposition cell = lab::Decompose(d, method);
      ExpectMatched(cell, saddles, method);
      if (HasFatalFailure()) return;
      for (int v = 0; v < kMaxVertices; ++v) {
        if (!(cell.complex.used_vertices >> v & 1)) continue;
        ASSERT_TRUE(std::isfinite(cell.density[v]) && cell.position[v].allFinite());
      }
      worst = std::max(worst, std::abs(AbsoluteVolumes(cell) - 1.0));
      altitude = std::min(altitude, SmallestAltitude(cell));
      ++checked;
    }
    std::printf("%s %d: %d cells, volume off by at most %.1e, smallest altitude %.3f\n",
                std::string(lab::NameOf(method)).c_str(), static_cast<int>(kind), checked, worst,
                altitude);
    // All alternating cells have six saddles.
    const bool all_left_out =
        method == lab::ComparedMethod::kTptd &&
        (kind == CellKind::kAlternating || kind == CellKind::kTiedAlternating);
    EXPECT_GT(checked, all_left_out ? -1 : kCellsOfAKind / 2);
    EXPECT_LE(worst, 1e-12);
    if (method != lab::ComparedMethod::kTptd) {
      EXPECT_GE(altitude, 0.11);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Decompositions,
                         ::testing::Values(lab::ComparedMethod::kBcc, lab::ComparedMethod::kTptd,
                                           lab::ComparedMethod::kTpbcc),
                         [](const auto& test) { return std::string(lab::NameOf(test.param)); });

TEST(FaceVertices, AgreeBitForBitFromBothSides) {
  std::mt19937_64 random(15);
  for (const CellKind kind : kCellKinds) {
    for (int n = 0; n < test::Scaled(3000); ++n) {
      const int axis = n % 3;
      const CellDensities low = RandomCell(kind, random);
      CellDensities high = RandomCell(kind, random);
      for (int k = 0; k < 4; ++k) {
        high[kFaceCorners[2 * axis][k]] = low[kFaceCorners[2 * axis + 1][k]];
      }
      for (int m = 0; m < 4; ++m) {
        const auto method = static_cast<lab::ComparedMethod>(m);
        const Decomposition a = lab::Decompose(low, method), b = lab::Decompose(high, method);
        const int va = kFirstFaceVertex + 2 * axis + 1, vb = kFirstFaceVertex + 2 * axis;
        ASSERT_EQ(a.complex.used_vertices >> va & 1, b.complex.used_vertices >> vb & 1);
        if (!(a.complex.used_vertices >> va & 1)) continue;
        Vec3 shifted = b.position[vb];
        shifted[axis] += 1.0;
        ASSERT_EQ(a.position[va], shifted);
        ASSERT_EQ(a.density[va], b.density[vb]);
      }
    }
  }
}

// --- Topology

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
  // The oracle of fresh cells, too.
  std::size_t oracle_wrong = 0;
  for (const LabelledCell& cell : cells) {
    CellTopology found = testing::TrilinearCell(cell.d).At(cell.isovalue);
    if (file.above == 0) found.above = found.below = 0;
    oracle_wrong += found != cell.expected;
  }
  EXPECT_EQ(oracle_wrong, 0u);
  for (const auto method : {lab::ComparedMethod::kTpbcc, lab::ComparedMethod::kBcc}) {
    std::size_t wrong = 0;
    for (const LabelledCell& cell : cells) {
      CellTopology found = lab::CountCellTopology(lab::Decompose(cell.d, method), cell.isovalue);
      if (file.above == 0) found.above = found.below = 0;
      wrong += found != cell.expected;
    }
    std::printf("%s: %zu cells, wrong with %s: %zu\n", file.name, cells.size(),
                std::string(lab::NameOf(method)).c_str(), wrong);
    if (method == lab::ComparedMethod::kTpbcc) {
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

// Cells between tied voxels. In the first, two saddles are 2e-4 apart, on the two sides of a face.
// In the second, both are inside.
TEST(BodySaddle, IsFoundNextToAnother) {
  const CellDensities one_inside = {
      2.0000007611208468,     1.0000004368917481, 1.0000008008163432, 4.8667257801311332e-07,
      4.2827892274475639e-07, 1.000000621165906,  1.0000005997242616, 2.0000009156259173};
  EXPECT_EQ(FindBodySaddles(one_inside).count, 1);
  const CellDensities two_inside = {1.8125010710783746e-09, 1.0000000052767859,
                                    2.8164311338029619e-09, 1.0000000028477793,
                                    1.0000000055450855,     5.5610337811471066e-10,
                                    1.0000000040775514,     2.5356795648106878e-09};
  const BodySaddles two = FindBodySaddles(two_inside);
  ASSERT_EQ(two.count, 2);
  EXPECT_GT((two.saddle[0].position - two.saddle[1].position).norm(), 1e-6);
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
