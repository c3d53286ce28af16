#include "common/isosurface/decomposition.h"

#include "common/isosurface/placement.h"

namespace palpate {

CellSaddles::CellSaddles(const CellDensities& d) {
  for (int f = 0; f < 6; ++f) {
    const auto& k = kFaceCorners[f];
    face[f] = FindFaceSaddle(d[k[0]], d[k[1]], d[k[2]], d[k[3]]);
    count += face[f].exists;
  }
}

Vec3 OnFace(int face, double b, double c) {
  const int axis = face / 2;
  Vec3 p(b, axis == 2 ? c : b, c);
  p[axis] = face % 2;
  return p;
}

void PlaceCorners(const CellDensities& d, Decomposition& out) {
  for (int v = 0; v < 8; ++v) {
    out.position[v] = Vec3::Map(kPlainPositions[v].data());
    out.density[v] = d[v];
  }
}

void PlaceFaceCentre(const CellDensities& d, int face, Decomposition& out) {
  const int v = kFirstFaceVertex + face;
  out.position[v] = Vec3::Map(kPlainPositions[v].data());
  out.density[v] = MeanOfFace(d, face);
}

void PlaceAtSaddle(int face, const FaceSaddle& saddle, Decomposition& out) {
  out.position[kFirstFaceVertex + face] = OnFace(face, saddle.b, saddle.c);
  out.density[kFirstFaceVertex + face] = saddle.density.value();
}

void DecomposeBcc(const CellDensities& d, Decomposition& out) {
  PlaceCorners(d, out);
  out.complex = kSingleComplex;
  out.is_plain = false;
  for (int face = 0; face < 6; ++face) PlaceFaceCentre(d, face, out);
  out.position[kFirstInteriorVertex] = Vec3::Constant(0.5);
  out.density[kFirstInteriorVertex] = MeanOfCell(d);
}

void Decompose(const CellDensities& d, DecompositionMethod method, Decomposition& out) {
  out.face_saddle_count = out.body_saddle_count = 0;
  method == DecompositionMethod::kBcc ? DecomposeBcc(d, out) : DecomposeTpbcc(d, out);
}

}  // namespace palpate
