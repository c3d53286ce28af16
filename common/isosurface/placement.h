// Places the vertices of decompositions: functions that the methods share.
//
// Frame: index coordinates local to the cell.
// Threads: pure functions. Real-time: no allocation, no locks.
#pragma once

#include "common/isosurface/decomposition.h"
#include "common/isosurface/saddles.h"

namespace palpate {

// The saddles of a cell, as the methods need them.
struct CellSaddles {
  std::array<FaceSaddle, 6> face;
  int count = 0;

  explicit CellSaddles(const CellDensities& d);
};

inline double MeanOfFace(const CellDensities& d, int face) {
  const auto& k = kFaceCorners[face];
  return ((d[k[0]] + d[k[1]]) + (d[k[2]] + d[k[3]])) * 0.25;
}

// F at the centre of the cell.
inline double MeanOfCell(const CellDensities& d) {
  return (((d[0] + d[3]) + (d[2] + d[1])) + ((d[4] + d[7]) + (d[6] + d[5]))) * 0.125;
}

// Returns the point (b, c) of a face; b and c are along the face's two axes, in their order.
Vec3 OnFace(int face, double b, double c);

void PlaceCorners(const CellDensities& d, Decomposition& out);
void PlaceFaceCentre(const CellDensities& d, int face, Decomposition& out);
// Puts the face vertex at the saddle itself.
void PlaceAtSaddle(int face, const FaceSaddle& saddle, Decomposition& out);

// One function for each method.
void DecomposeBcc(const CellDensities& d, Decomposition& out);
void DecomposeTpbcc(const CellDensities& d, Decomposition& out);

// For rule 2 of DecomposeTpbcc: the corner that the first of two interior vertices serves, and the
// densities of both. `corner` is negative if the three lowest faces share no corner; with exact
// arithmetic this cannot happen.
struct InteriorPair {
  int corner = -1;
  Vec3 towards;  // from the centre to the corner, doubled
  double at_corner = 0.0, opposite = 0.0;
  BodySaddles body;
};
InteriorPair FindInteriorPair(const CellDensities& d, const CellSaddles& saddles,
                              const SaddlePattern& pattern);

// The densities that a single interior vertex may have without changing the topology: between the
// last joining and the first splitting saddle.
struct Interval {
  double low, high;
};
Interval InteriorInterval(const CellDensities& d, const CellSaddles& saddles,
                          const SaddlePattern& pattern);

}  // namespace palpate
