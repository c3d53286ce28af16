// Single moves of the proxy.
#include "server/haptics/moves.h"

#include <gtest/gtest.h>

#include "tests/support/made_volume.h"

namespace palpate {
namespace {

// From a vertex of a crossed cell along the edge of a free one: what the move leaves as
// it is, is where the vertex lies, and nothing that the place was before.
TEST(MoveInBox, BeginsWhereTheSimplexIs) {
  const auto volume =
      testing::MakeVolume({8, 8, 8}, [](int i, int j, int k) { return i + 0.1 * j + 0.01 * k; });
  const HapticSurface surface =
      MakeHapticSurface(*volume, AffineMap(), 0.5, DecompositionMethod::kTpbcc, 1);
  Place place;
  place.kind = Place::Kind::kSimplex;
  place.cell = Vec3i(2, 3, 3);
  place.p_I = Vec3(0.25, 7.5, -30.0);  // of no simplex
  place.carrier.count = 1;
  place.carrier.vertex[0] = static_cast<std::uint8_t>(CornerAt(1, 0, 1));
  place.carrier.weight[0] = 1.0;
  place.faces = FacesOf(place.carrier);
  Candidate candidate;
  candidate.kind = Candidate::Kind::kBox;
  candidate.cell = Vec3i(3, 3, 4);
  candidate.faces = 0x15;
  candidate.d_mm = Vec3(0.0, 0.5, 0.0);
  CellCache cache;
  MoveInBox(surface, candidate, place, cache);
  EXPECT_EQ(place.kind, Place::Kind::kBox);
  EXPECT_EQ(place.p_I, Vec3(3.0, 3.5, 4.0));
  EXPECT_EQ(place.faces, 0x11);
}

// All tetrahedra would be more than a cell has, and all faces more than a cone has room for.
TEST(Place, WithoutVerticesIsInNoTetrahedronAndOnNoFace) {
  const auto volume = testing::MakeVolume({4, 4, 4}, [](int i, int, int) { return i; });
  const HapticSurface surface =
      MakeHapticSurface(*volume, AffineMap(), 0.5, DecompositionMethod::kTpbcc, 1);
  CellCache cache;
  const TetrahedralComplex& complex = cache.Decomposed(surface, Vec3i(1, 1, 1)).parts.complex;
  EXPECT_EQ(TetrahedraAt(complex, Carrier()), 0u);
  EXPECT_EQ(FacesOf(Carrier()), 0u);
}

}  // namespace
}  // namespace palpate
