#include "server/lab/compared_method.h"

namespace palpate::lab {
namespace {

// The partner of the n-th lowest face.
enum class FacePartner : std::uint8_t {
  kByRank,    // as printed: the n-th highest, parallel to it or not
  kParallel,  // the opposite face, whatever its rank; nothing overlaps then
};

void PlaceAtMeanOfSaddles(const CellSaddles& saddles, Decomposition& out) {
  Vec3 position = Vec3::Zero();
  double density = 0.0;
  for (int face = 0; face < 6; ++face) {
    if (!saddles.face[face].exists) continue;
    position += out.position[kFirstFaceVertex + face];
    density += out.density[kFirstFaceVertex + face];
  }
  out.position[kFirstInteriorVertex] = position / saddles.count;
  out.density[kFirstInteriorVertex] = density / saddles.count;
}

// Adds half of the last case: the polyhedra of the faces `pyramid`, `type_1` and `type_2` around
// `own`. The three faces meet at a corner. `other` is the vertex of the other half.
void AddHalf(int pyramid, int type_1, int type_2, int own, int other, TetrahedralComplex& complex) {
  // An interior vertex may replace a face vertex; some tetrahedra would be flat then.
  const auto add = [&](int a, int b, int c, int d) {
    if (a != c && b != c) complex.Add(a, b, c, d);
  };
  const auto add_triangle = [&](int apex, int face, int n) {
    const auto& k = kFaceCorners[face];
    if (apex != kFirstFaceVertex + face) {
      complex.Add(apex, kFirstFaceVertex + face, k[n], k[(n + 1) % 4]);
    }
  };
  for (int n = 0; n < 4; ++n) {
    add_triangle(own, pyramid, n);
    add_triangle(own, type_1, n);
  }
  for (const auto& [u, v, f, g] : kCubeEdges) {
    if ((kVertexFaces[u] & kVertexFaces[v]) == (1u << type_1 | 1u << (pyramid ^ 1))) {
      complex.Add(own, other, u, v);
    }
  }
  const auto& k = kFaceCorners[type_2];
  const unsigned near = 1u << pyramid | 1u << type_1;
  const auto is_own = [&](int n) {
    return (kVertexFaces[k[n]] & kVertexFaces[k[(n + 1) % 4]] & near) != 0;
  };
  for (int n = 0; n < 4; ++n) {
    add_triangle(is_own(n) ? own : other, type_2, n);
    if (is_own(n) != is_own((n + 3) % 4)) add(own, other, kFirstFaceVertex + type_2, k[n]);
  }
}

// Puts an interior vertex at the body saddle with this density, and returns that vertex. If there
// is no such saddle, returns the vertex of the face saddle with this density.
int PlaceAtBodySaddle(int v, int face, double density, const BodySaddles& body,
                      Decomposition& out) {
  for (int n = 0; n < body.count; ++n) {
    if (body.saddle[n].density != density) continue;
    out.position[v] = body.saddle[n].position;
    out.density[v] = density;
    return v;
  }
  return kFirstFaceVertex + face;
}

// The published rules for cells with six face saddles (Corenthy et al., section 3.4). Table 4 shows
// that the published TPTD uses the same rules.
//
// `out` already has the corners, and the six face vertices at their saddles.
void DecomposeSixSaddles(const CellDensities& d, const CellSaddles& saddles, FacePartner partner,
                         Decomposition& out) {
  const SaddlePattern pattern = ClassifySaddles(d, saddles.face);
  const InteriorPair pair =
      pattern.IsInterleavedSix() ? FindInteriorPair(d, saddles, pattern) : InteriorPair{};
  out.body_saddle_count = pair.body.count;
  if (pair.body.count == 0) {
    PlaceAtMeanOfSaddles(saddles, out);
    out.complex = MakeFlippedComplex(0xfff, 0xff);
    return;
  }
  const auto& f = pattern.face;
  const int a = PlaceAtBodySaddle(kFirstInteriorVertex, f[2], pair.at_corner, pair.body, out);
  const int b = PlaceAtBodySaddle(kFirstInteriorVertex + 1, f[3], pair.opposite, pair.body, out);
  const bool parallel = partner == FacePartner::kParallel;
  AddHalf(f[0], f[1], f[2], a, b, out.complex);
  AddHalf(parallel ? f[0] ^ 1 : f[5], parallel ? f[1] ^ 1 : f[4], parallel ? f[2] ^ 1 : f[3], b, a,
          out.complex);
}

// The topology-preserving decomposition as published (Corenthy et al., section
// 3.4), faults included: for comparison.
//
//   no saddle               BCC
//   1 face saddle           the other five faces joined to it
//   2 to 4 face saddles     an interior vertex at their mean, with the mean of
//                           their densities (only so its Table 4 is met)
//   a body saddle, at most
//   4 face saddles          an interior vertex at the body saddle
//   6 face saddles          the "diamond": the octahedron of the face saddles
//                           around their mean, 28 tetrahedra
//   6 and a body saddle     two interior vertices a and b, 30 tetrahedra. Claims that the
//                           sorted faces f1..f6 pair up as parallel faces (f1 with f6, and
//                           so on). Half of these cells break the claim.
//
// The last case is our reading of a paragraph that leaves the details open. Of all readings that
// keep the topology where the claim holds, this one is closest to Table 4: for 13.5.1 and 13.5.2 we
// get 12.53 and 9.44, Table 4 has 12.40 and 9.54. The next best reading, with f1 and f6 for type
// II, gets 12.27 and 9.60. In case 13.1 the claim does not hold. Table 4 has 10.31; we get 10.17 if
// gaps count as inside, 9.9 if they are left out, and 14.4 if they count as free. With parallel
// faces instead of ranks (as in kTptd) we get 10.31, every cell is right and nothing overlaps. So
// the authors' program may well have used parallel faces. a is the body saddle on the side of the
// corner that f1, f2, f3 share; b is the other body saddle:
//   pyramids   f1 with apex a, f6 with apex b                         4 tetrahedra
//   type I     f2 (f5): a pyramid, and a tetrahedron that joins its    5
//              edge far from f1 (f6) to a and b
//   type II    f3 (f4): two triangles joined to a, two to b, and two   6
//              tetrahedra that fill the wedge between them
// Two triangles of f3 face f1 and f2; these are joined to a. The same holds for f4 with f6, f5 and
// b. Where the claim fails, the halves overlap in places and leave gaps in others.
void DecomposeTpbccPublished(const CellDensities& d, Decomposition& out) {
  const CellSaddles saddles(d);
  out.face_saddle_count = saddles.count;
  for (int face = 0; face < 6; ++face) {
    if (saddles.face[face].exists) {
      PlaceAtSaddle(face, saddles.face[face], out);
    } else {
      PlaceFaceCentre(d, face, out);
    }
  }
  if (saddles.count == 6) {
    DecomposeSixSaddles(d, saddles, FacePartner::kByRank, out);
    return;
  }
  const BodySaddles body = saddles.count > 0 ? FindBodySaddles(d) : BodySaddles{};
  out.body_saddle_count = body.count;
  out.complex = kSingleComplex;
  if (body.count > 0) {
    out.position[kFirstInteriorVertex] = body.saddle[0].position;
    out.density[kFirstInteriorVertex] = body.saddle[0].density;
  } else if (saddles.count == 0) {
    out.position[kFirstInteriorVertex] = Vec3::Constant(0.5);
    out.density[kFirstInteriorVertex] = MeanOfCell(d);
  } else if (saddles.count == 1) {
    out.complex = TetrahedralComplex{};
    for (int face = 0; face < 6; ++face) {
      if (saddles.face[face].exists) continue;
      for (int f = 0; f < 6; ++f) {
        if (saddles.face[f].exists) out.complex.AddFacePyramid(kFirstFaceVertex + f, face);
      }
    }
  } else {
    PlaceAtMeanOfSaddles(saddles, out);
  }
}

// Calls visit(a, b, c) for the boundary triangles of a face.
template <class Visitor>
void VisitFaceTriangles(int face, bool has_saddle, Visitor visit) {
  const auto& k = kFaceCorners[face];
  if (has_saddle) {
    for (int n = 0; n < 4; ++n) visit(kFirstFaceVertex + face, k[n], k[(n + 1) % 4]);
  } else {
    visit(k[0], k[1], k[2]);
    visit(k[0], k[2], k[3]);
  }
}

// Joins the apex to every boundary triangle that does not lie on a face with it.
void JoinToApex(int apex, const CellSaddles& saddles, Decomposition& out) {
  for (int face = 0; face < 6; ++face) {
    if (kVertexFaces[apex] >> face & 1) continue;
    VisitFaceTriangles(face, saddles.face[face].exists,
                       [&](int a, int b, int c) { out.complex.Add(apex, a, b, c); });
  }
}

// Sohn's decomposition: corners and saddles only (Corenthy et al., section 3.3).
//
// Faces with a saddle are split around it, all others along the diagonal from their (0,0) to their
// (1,1). All boundary triangles are joined to one apex. The apex is
// - the diagonal's corner if there are no saddles
// - the body saddle if there is one
// - otherwise the face saddle in the middle of the sorted face saddles
// Six face saddles are handled as in kTpbccPublished, which has the same figures in Table 4. But
// the second half of the cell uses the faces opposite to those of the first half, instead of
// trusting their ranks, so that the halves fill the cell. The "diamond" may still overlap itself.
//
// `out` already has the corners.
void DecomposeTptd(const CellDensities& d, Decomposition& out) {
  const CellSaddles saddles(d);
  out.face_saddle_count = saddles.count;
  for (int face = 0; face < 6; ++face) {
    if (saddles.face[face].exists) PlaceAtSaddle(face, saddles.face[face], out);
  }
  if (saddles.count == 6) {
    DecomposeSixSaddles(d, saddles, FacePartner::kParallel, out);
    return;
  }
  const BodySaddles body = saddles.count > 0 ? FindBodySaddles(d) : BodySaddles{};
  out.body_saddle_count = body.count;
  int apex = 0;
  if (body.count > 0) {
    apex = kFirstInteriorVertex;
    out.position[apex] = body.saddle[0].position;
    out.density[apex] = body.saddle[0].density;
  } else if (saddles.count > 0) {
    apex = kFirstFaceVertex + ClassifySaddles(d, saddles.face).face[(saddles.count - 1) / 2];
  }
  JoinToApex(apex, saddles, out);
}

}  // namespace

std::optional<ComparedMethod> MethodNamed(std::string_view name) {
  for (int n = 0; n < kMethodCount; ++n) {
    if (kMethodNames[n] == name) return static_cast<ComparedMethod>(n);
  }
  return std::nullopt;
}

Decomposition Decompose(const CellDensities& d, ComparedMethod method) {
  for (const auto felt : {DecompositionMethod::kBcc, DecompositionMethod::kTpbcc}) {
    if (method == Compared(felt)) return palpate::Decompose(d, felt);
  }
  Decomposition out;
  PlaceCorners(d, out);
  method == ComparedMethod::kTptd ? DecomposeTptd(d, out) : DecomposeTpbccPublished(d, out);
  return out;
}

}  // namespace palpate::lab
