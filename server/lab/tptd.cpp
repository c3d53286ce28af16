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
#include "server/lab/six_saddles.h"

namespace palpate::lab {
namespace {

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

}  // namespace

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

}  // namespace palpate::lab
