// The decomposition of a cell: topology, geometry, agreement of neighbours.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "common/isosurface/decomposition.h"
#include "common/isosurface/saddles.h"
#include "common/isosurface/ties.h"
#include "tests/support/cell_topology.h"
#include "tests/support/places.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using testing::CellTopology;
using testing::TopologyOf;

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

struct LabelledRow {
  CellDensities d;
  double isovalue;
  CellTopology expected;
};

// `skipped` columns stand between τ and the counts.
std::vector<LabelledRow> ReadRows(const std::string& name, int skipped) {
  std::ifstream file(std::filesystem::path(test::kCells) / name);
  std::vector<LabelledRow> rows;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream in(line);
    LabelledRow row;
    for (double& d : row.d) in >> d;
    in >> row.isovalue;
    for (int ignored, n = 0; n < skipped; ++n) in >> ignored;
    in >> row.expected.above >> row.expected.below >> row.expected.surface >> row.expected.euler;
    EXPECT_TRUE(in) << line;
    rows.push_back(row);
  }
  return rows;
}

int CountWrong(const std::vector<LabelledRow>& rows, DecompositionMethod method) {
  int wrong = 0;
  for (LabelledRow row : rows) {
    const CellDensities d = Resolve(row.d, row.isovalue);
    wrong += !(TopologyOf(Decompose(d, method), row.isovalue) == row.expected);
  }
  return wrong;
}

TEST(Topology, EqualsTheLabelsOfRandomCells) {
  const auto rows = ReadRows("labelled.csv", 2);
  ASSERT_EQ(rows.size(), 25000u);
  const int wrong = CountWrong(rows, DecompositionMethod::kTpbcc);
  const int wrong_bcc = CountWrong(rows, DecompositionMethod::kBcc);
  std::printf("labelled.csv: %zu rows, wrong: tpbcc %d, bcc %d\n", rows.size(), wrong, wrong_bcc);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(wrong_bcc, 100);  // the control: BCC does not keep topology
}

TEST(Topology, EqualsTheLabelsOfTiedCells) {
  const auto rows = ReadRows("ties.csv", 0);
  ASSERT_EQ(rows.size(), 12000u);
  const int wrong = CountWrong(rows, DecompositionMethod::kTpbcc);
  std::printf("ties.csv: %zu rows, wrong: tpbcc %d\n", rows.size(), wrong);
  EXPECT_EQ(wrong, 0);
}

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

double Volume(const Decomposition& cell, int t) {
  const auto& v = cell.complex.vertices[t];
  const Vec3 o = cell.position[v[0]];
  return std::abs((cell.position[v[1]] - o)
                      .cross(cell.position[v[2]] - o)
                      .dot(cell.position[v[3]] - o)) /
         6.0;
}

TEST(Decomposition, FillsTheCellWithoutNeedles) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform;
  std::uniform_int_distribution<int> level(0, 3);
  int doubles = 0;
  double smallest = 1.0;
  for (int n = 0; n < test::Scaled(60000); ++n) {
    CellDensities raw;
    for (double& x : raw) x = n % 3 == 0 ? level(random) : uniform(random);
    if (n % 3 == 1) {
      for (int v = 0; v < 8; ++v) {
        const auto& o = kCornerOffset[v];
        raw[v] = raw[v] / 2 + ((o[0] + o[1] + o[2]) % 2) / 2.0;
      }
    }
    double unused = 0.5;
    const Decomposition cell = Decompose(Resolve(raw, unused), DecompositionMethod::kTpbcc);
    double sum = 0.0;
    for (int t = 0; t < cell.complex.tetrahedron_count; ++t) {
      const double volume = Volume(cell, t);
      sum += volume;
      smallest = std::min(smallest, volume);
    }
    ASSERT_NEAR(sum, 1.0, 1e-12);
    doubles += cell.complex.used_vertices >> 15 & 1;
  }
  std::printf("smallest tetrahedron %.4f of the cell, two interior vertices in %d cells\n",
              smallest, doubles);
  EXPECT_GT(smallest, 0.01);
  EXPECT_GT(doubles, 100);
}

TEST(Decomposition, FaceVerticesAgreeBitForBitFromBothSides) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform;
  for (int n = 0; n < 5000; ++n) {
    for (int axis = 0; axis < 3; ++axis) {
      CellDensities low, high;
      for (double& x : low) x = uniform(random);
      for (double& x : high) x = uniform(random);
      for (int k = 0; k < 4; ++k) {
        high[kFaceCorners[2 * axis][k]] = low[kFaceCorners[2 * axis + 1][k]];
      }
      const Decomposition a = Decompose(low, DecompositionMethod::kTpbcc);
      const Decomposition b = Decompose(high, DecompositionMethod::kTpbcc);
      const int va = kFirstFaceVertex + 2 * axis + 1, vb = kFirstFaceVertex + 2 * axis;
      Vec3 shifted = b.position[vb];
      shifted[axis] += 1.0;
      ASSERT_EQ(a.position[va], shifted);
      ASSERT_EQ(a.density[va], b.density[vb]);
    }
  }
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
