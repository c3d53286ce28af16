// Why the diamond keeps the topology: flips of five vertices, the densities with which they change
// nothing, and the cells that need none.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <random>
#include <vector>

#include "common/isosurface/decomposition.h"
#include "common/isosurface/placement.h"
#include "server/lab/cell_topology.h"
#include "tests/support/random_cell.h"
#include "tests/support/scaled.h"
#include "tests/support/trilinear_cell.h"

namespace palpate {
namespace {

constexpr int kO = kFirstInteriorVertex;

lab::CellTopology TopologyOf(const TetrahedralComplex& complex,
                             const std::array<double, kMaxVertices>& density, double isovalue) {
  Decomposition cell;
  cell.complex = complex;
  cell.density = density;
  return lab::CountCellTopology(cell, isovalue);
}

// Two tetrahedra around the triangle 0 1 2, with the ends 3 and 4; or three around the edge 3 4.
TetrahedralComplex TwoTetrahedra() {
  TetrahedralComplex complex;
  complex.Add(0, 1, 2, 3);
  complex.Add(0, 1, 2, 4);
  return complex;
}
TetrahedralComplex ThreeTetrahedra() {
  TetrahedralComplex complex;
  for (int n = 0; n < 3; ++n) complex.Add(n, (n + 1) % 3, 3, 4);
  return complex;
}

TEST(Flip, ChangesALevelSetOnlyIfItsEndsAreApartFromTheOthers) {
  for (unsigned above = 0; above < 32; ++above) {
    std::array<double, kMaxVertices> density{};
    for (int v = 0; v < 5; ++v) density[v] = above >> v & 1 ? 1.0 : 0.0;
    const bool apart = above == 0b00111 || above == 0b11000;
    EXPECT_EQ(
        TopologyOf(TwoTetrahedra(), density, 0.5) != TopologyOf(ThreeTetrahedra(), density, 0.5),
        apart)
        << above;
  }
}

// --- Cells

// Also with equal corners, as the last bits of ties may leave them.
TEST(Diamond, IsPlainWhereNoFaceHasASaddle) {
  std::mt19937_64 random(11);
  int plain = 0;
  for (int n = 0; n < 200'000; ++n) {
    CellDensities d;
    for (double& density : d) density = static_cast<double>(random() % (n % 2 == 0 ? 4 : 1000));
    const Decomposition cell = Decompose(d, DecompositionMethod::kTpbcc);
    ASSERT_EQ(cell.is_plain, CellSaddles(d).count == 0);
    if (!cell.is_plain) continue;
    ++plain;
    ASSERT_EQ(cell.complex.vertices, kDiamondComplexes[0].vertices);
    for (int v = 0; v < kFirstInteriorVertex; ++v) {
      ASSERT_EQ(cell.position[v], Vec3::Map(kPlainPositions[v].data()));
    }
  }
  EXPECT_GT(plain, 10'000);
}

using testing::CellKind, testing::kExactCells, testing::RandomCell;

// Between densities that are nearer to each other, rounding decides.
constexpr double kRounding = 1e-12;

// A cell as kTpbcc cuts it, and an isovalue between every two densities of its vertices.
struct Cut {
  CellDensities d;
  Decomposition cell;
  CellSaddles saddles;
  SaddlePattern pattern;
  BodySaddles body;
  testing::TrilinearCell v;
  std::vector<double> isovalues;

  explicit Cut(const CellDensities& densities)
      : d(densities),
        cell(Decompose(d, DecompositionMethod::kTpbcc)),
        saddles(d),
        pattern(ClassifySaddles(d, saddles.face)),
        body(FindBodySaddles(d)),
        v(d) {
    std::vector<double> values = v.BodySaddleDensities();
    for (int n = 0; n < kMaxVertices; ++n) {
      if (cell.complex.used_vertices >> n & 1) values.push_back(cell.density[n]);
    }
    std::sort(values.begin(), values.end());
    for (std::size_t n = 0; n + 1 < values.size(); ++n) {
      if (values[n + 1] - values[n] > kRounding)
        isovalues.push_back(0.5 * (values[n] + values[n + 1]));
    }
  }
};

TEST(FreshCells, HaveTheTopologyOfV) {
  std::mt19937_64 random(20);
  std::array<int, 3> vertices_inside{};
  int cells = 0, pairs = 0, wrong = 0;
  for (const CellKind kind : kExactCells) {
    for (int n = 0; n < test::Scaled(8000); ++n, ++cells) {
      const Cut cut(RandomCell(kind, random));
      const unsigned inside = cut.cell.complex.used_vertices >> kO;  // 0, 1, 3
      ++vertices_inside[std::popcount(inside)];
      for (const double isovalue : cut.isovalues) {
        ++pairs;
        wrong += lab::CountCellTopology(cut.cell, isovalue) != cut.v.At(isovalue);
      }
    }
  }
  std::printf("%d cells with 0, 1, 2 vertices inside: %d, %d, %d; %d level sets, %d wrong\n", cells,
              vertices_inside[0], vertices_inside[1], vertices_inside[2], pairs, wrong);
  EXPECT_EQ(wrong, 0);
  for (const int count : vertices_inside) EXPECT_GT(count, cells / 100);
}

bool Separates(std::initializer_list<double> ends, std::initializer_list<double> others) {
  return std::max(ends) < std::min(others) || std::max(others) < std::min(ends);
}

// The flips that O's density allows, judged by the lemma alone.
struct Flips {
  unsigned edges = 0, corners = 0;
  bool all() const { return edges == 0xFFF && corners == 0xFF; }
};
Flips NeutralFlips(const std::array<double, kMaxVertices>& d) {
  Flips flips;
  for (int n = 0; n < 12; ++n) {
    const CubeEdge& e = kCubeEdges[n];
    if (!Separates({d[e.f], d[e.g]}, {d[e.u], d[e.v], d[kO]})) flips.edges |= 1u << n;
  }
  for (int c = 0; c < 8; ++c) {
    const auto& [f, g, h] = kFacesAtCorner[c];
    if (!Separates({d[c], d[kO]}, {d[f], d[g], d[h]})) flips.corners |= 1u << c;
  }
  return flips;
}

// Some of these flips: a corner needs its three edges, and a complex has room for 30 tetrahedra.
Flips SomeOf(Flips flips, std::mt19937_64& random) {
  flips.edges &= static_cast<unsigned>(random());
  flips.corners &= static_cast<unsigned>(random());
  for (int n = 0; n < 12; ++n) {
    if (!(flips.edges >> n & 1)) flips.corners &= ~(1u << kCubeEdges[n].u | 1u << kCubeEdges[n].v);
  }
  while (24 + std::popcount(flips.edges) - std::popcount(flips.corners) > kMaxTetrahedra) {
    flips.corners = 0;
    flips.edges &= flips.edges - 1;
  }
  return flips;
}

// Without a body saddle, O's density may be any in the interior interval; all of them, and any
// neutral flips, give level sets like V's.
TEST(Flip, ThatIsNeutralKeepsTheTopologyOfV) {
  std::mt19937_64 random(21);
  std::uniform_real_distribution<double> uniform;
  int compared = 0, whole = 0;
  for (const CellKind kind : kExactCells) {
    for (int n = 0; n < test::Scaled(4000); ++n) {
      const Cut cut(RandomCell(kind, random));
      if (cut.body.count > 0 || cut.saddles.count == 6) continue;
      const Interval interval = InteriorInterval(cut.d, cut.saddles, cut.pattern);
      std::array<double, kMaxVertices> density = cut.cell.density;
      density[kO] = interval.low + uniform(random) * (interval.high - interval.low);
      const Flips neutral = NeutralFlips(density);
      const Flips some = SomeOf(neutral, random);
      whole += neutral.all();
      for (const double isovalue : cut.isovalues) {
        if (isovalue == density[kO]) continue;
        ++compared;
        const auto flipped = MakeFlippedComplex(some.edges, some.corners);
        ASSERT_EQ(TopologyOf(flipped, density, isovalue), cut.v.At(isovalue));
      }
    }
  }
  std::printf("%d level sets; all flips neutral in %d cells\n", compared, whole);
  EXPECT_GT(compared, test::Scaled(4000));
  EXPECT_GT(whole, test::Scaled(400));
}

// The proof is in deploy/guides/method.md.
TEST(Diamond, WithoutFaceSaddlesEveryDiagonalHasDiscsOnly) {
  std::mt19937_64 random(22);
  int cells = 0;
  for (const CellKind kind : kExactCells) {
    for (int n = 0; n < test::Scaled(20'000); ++n) {
      const Cut cut(RandomCell(kind, random));
      if (cut.saddles.count > 0) continue;
      ++cells;
      for (const TetrahedralComplex& diamond : kDiamondComplexes) {
        for (const double isovalue : cut.isovalues) {
          ASSERT_EQ(TopologyOf(diamond, cut.cell.density, isovalue),
                    (lab::CellTopology{1, 1, 1, 1}));
        }
      }
    }
  }
  std::printf("%d cells\n", cells);
  EXPECT_GT(cells, test::Scaled(10'000));
}

TEST(Diamond, OfSixFaceSaddlesEveryDiagonalFits) {
  std::mt19937_64 random(23);
  int cells = 0;
  for (int n = 0; n < test::Scaled(20'000); ++n) {
    const Cut cut(RandomCell(CellKind::kAlternating, random));
    if (cut.saddles.count != 6 || cut.body.count > 0) continue;
    ++cells;
    EXPECT_FALSE(cut.cell.complex.used_vertices >> kO);
    for (const TetrahedralComplex& diamond : kDiamondComplexes) {
      for (const double isovalue : cut.isovalues) {
        ASSERT_EQ(TopologyOf(diamond, cut.cell.density, isovalue), cut.v.At(isovalue));
      }
    }
  }
  std::printf("%d cells\n", cells);
  EXPECT_GT(cells, test::Scaled(4000));
}

}  // namespace
}  // namespace palpate
