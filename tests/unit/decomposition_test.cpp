// Every decomposition is a triangulation of its cell, on any input.
#include "common/isosurface/decomposition.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <set>

#include "common/isosurface/placement.h"
#include "common/isosurface/ties.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

enum class Kind { kRandom, kAlternating, kTied, kNearTied, kHugeRange, kSubnormal };
constexpr Kind kKinds[] = {Kind::kRandom,   Kind::kAlternating, Kind::kTied,
                           Kind::kNearTied, Kind::kHugeRange,   Kind::kSubnormal};
CellDensities MakeCell(Kind kind, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform;
  std::uniform_int_distribution<int> level(0, 3);
  CellDensities d;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    const double u = uniform(random);
    switch (kind) {
      case Kind::kRandom:
        d[v] = u;
        break;
      case Kind::kAlternating:
        d[v] = (u + (o[0] + o[1] + o[2]) % 2) / 2.0;
        break;
      case Kind::kTied:
        d[v] = ResolvedDensity(level(random) / 3.0, o[0], o[1], o[2]);
        break;
      case Kind::kNearTied:
        d[v] = level(random) / 3.0 + 1e-15 * u;
        break;
      case Kind::kHugeRange:
        d[v] = std::ldexp(u - 0.5, level(random) * 300);
        break;
      case Kind::kSubnormal:
        d[v] = std::ldexp(u, -1060);
        break;
    }
  }
  return d;
}

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
                   DecompositionMethod method) {
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
    const bool around = method != DecompositionMethod::kTptd || saddles.face[face].exists;
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

class Decompositions : public ::testing::TestWithParam<DecompositionMethod> {};

// Matched triangles and a boundary that is the cube's make the signed volumes sum
// to 1; then no tetrahedron is inverted if and only if the absolute ones do too.
TEST_P(Decompositions, FillTheCell) {
  const DecompositionMethod method = GetParam();
  for (Kind kind : kKinds) {
    SCOPED_TRACE(static_cast<int>(kind));
    std::mt19937_64 random(13);
    double worst = 0.0, altitude = 1.0;
    int checked = 0;
    for (int n = 0; n < kCellsOfAKind; ++n) {
      const CellDensities d = MakeCell(kind, random);
      const CellSaddles saddles(d);
      // The diamond of six saddles need not be star-shaped.
      if (method == DecompositionMethod::kTptd && saddles.count == 6) continue;
      const Decomposition cell = Decompose(d, method);
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
    // All alternating cells have six saddles.
    const bool all_left_out = method == DecompositionMethod::kTptd && kind == Kind::kAlternating;
    EXPECT_GT(checked, all_left_out ? -1 : kCellsOfAKind / 2);
    EXPECT_LE(worst, 1e-12);
    if (IsSafe(method)) {
      EXPECT_GE(altitude, 0.05);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Decompositions,
                         ::testing::Values(DecompositionMethod::kBcc, DecompositionMethod::kTptd,
                                           DecompositionMethod::kTpbcc),
                         [](const auto& test) { return std::string(MethodName(test.param)); });

TEST(FaceVertices, AgreeBitForBitFromBothSides) {
  std::mt19937_64 random(15);
  for (Kind kind : kKinds) {
    for (int n = 0; n < test::Scaled(3000); ++n) {
      const int axis = n % 3;
      const CellDensities low = MakeCell(kind, random);
      CellDensities high = MakeCell(kind, random);
      for (int k = 0; k < 4; ++k) {
        high[kFaceCorners[2 * axis][k]] = low[kFaceCorners[2 * axis + 1][k]];
      }
      for (int m = 0; m < 4; ++m) {
        const auto method = static_cast<DecompositionMethod>(m);
        const Decomposition a = Decompose(low, method), b = Decompose(high, method);
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

}  // namespace
}  // namespace palpate
