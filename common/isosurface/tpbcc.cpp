// The topology-preserving decomposition: our own. Of a cell, the boundary is that of every method
// with face vertices. Only the inside is chosen (deploy/guides/method.md has the proofs):
//
//   1. No body saddle: the diamond. Flips cut off all edges and corners, and the octahedron of the
//      face vertices is cut around a diagonal. A flip is neutral at every τ for an interval of O's
//      density. A diagonal fits if one of its densities is in the intervals of O and of all flips.
//   2. Six face saddles in the order JJSJSS and a body saddle: two interior vertices, one for the
//      faces at each of two opposite corners.
//   3. Every other cell: one interior vertex O, with the body saddle's density or with one strictly
//      between the last joining and the first splitting face saddle, and the neutral flips.
//
// Densities decide the topology, so positions are free: they are chosen for shape and accuracy.
// Tried (mean R_D in % of Table 4, of 3000 uniform and of as many alternating cells; now 5.22, 2.37
// and 4.64):
// - kSaddleShare 0: 5.47, 2.41, 4.62; 0.5: 5.08, 2.39, 4.72; 1: 5.02, 2.42, 4.82
// - kInset 0.3: 5.23, 2.36, 4.65; kInteriorRoom 0: 5.30, 2.39, 4.64; 0.2: 5.24, 2.45, 4.64
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "common/isosurface/placement.h"

namespace palpate {
namespace {

// Face vertices keep this distance from the edges of their face.
constexpr double kInset = 0.37;
// How far a face vertex moves from the centre along the line on which F is that of the saddle.
constexpr double kSaddleShare = 0.25;
// How far a single interior vertex moves from the centre towards the body saddle, on each axis.
constexpr double kInteriorRoom = 0.08;
// Flips that would make a tetrahedron thinner, in edges of the cell, are left out.
constexpr double kLeastAltitude = 0.12;
// Two interior vertices lie at ½ ± one of these offsets on a diagonal of the cell.
constexpr double kNearOffset = 0.1, kFarOffset = 0.2;
// The place of an assigned density in its interval, as a fraction from the nearer end.
constexpr double kIntervalShare = 0.1;

// F is constant along the two lattice lines through the saddle. The face vertex lies on the one
// that passes nearer to the centre.
void PlaceNearSaddle(int face, const FaceSaddle& saddle, Decomposition& out) {
  const auto within = [](double x) { return std::clamp(x, kInset, 1.0 - kInset); };
  const auto along = [](double x) { return 0.5 + kSaddleShare * (x - 0.5); };
  const bool keep_b = std::abs(saddle.b - 0.5) <= std::abs(saddle.c - 0.5);
  const double b = keep_b ? saddle.b : along(saddle.b);
  const double c = keep_b ? along(saddle.c) : saddle.c;
  out.position[kFirstFaceVertex + face] = OnFace(face, within(b), within(c));
  out.density[kFirstFaceVertex + face] = saddle.density.value();
}

Interval Hull(double a, double b) { return {std::min(a, b), std::max(a, b)}; }

// The densities of O with which a flip is neutral: where all of `corners` are on one side of all of
// `faces`, no τ may separate both O and the corners from the faces.
Interval NeutralInterval(const Interval& corners, const Interval& faces) {
  constexpr double kAny = std::numeric_limits<double>::infinity();
  return {corners.high < faces.low ? faces.low : -kAny,
          corners.low > faces.high ? faces.high : kAny};
}

Interval EdgeInterval(const Decomposition& cell, const CubeEdge& edge) {
  const auto& d = cell.density;
  return NeutralInterval(Hull(d[edge.u], d[edge.v]), Hull(d[edge.f], d[edge.g]));
}

Interval CornerInterval(const Decomposition& cell, int corner) {
  const auto& d = cell.density;
  const auto& [f, g, h] = kFacesAtCorner[corner];
  const Interval two = Hull(d[f], d[g]);
  return NeutralInterval({d[corner], d[corner]},
                         {std::min(two.low, d[h]), std::max(two.high, d[h])});
}

void Narrow(const Interval& by, Interval& interval) {
  interval.low = std::max(interval.low, by.low);
  interval.high = std::min(interval.high, by.high);
}

// Rule 1. Returns the axis of the diagonal that fits F best, or -1 if none keeps the topology.
// `interval`: of a single interior vertex.
int FindDiagonal(const CellDensities& d, Interval interval, int face_saddles,
                 const Decomposition& cell) {
  if (face_saddles < 6) {
    for (const CubeEdge& edge : kCubeEdges) Narrow(EdgeInterval(cell, edge), interval);
    for (int corner = 0; corner < 8; ++corner) Narrow(CornerInterval(cell, corner), interval);
    if (interval.low > interval.high) return -1;
  }
  const double centre = MeanOfCell(d);
  int best = -1;
  double smallest = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double a = cell.density[kFirstFaceVertex + 2 * axis];
    const double b = cell.density[kFirstFaceVertex + 2 * axis + 1];
    if (std::max(a, b) < interval.low || std::min(a, b) > interval.high) continue;
    const double difference = std::abs(0.5 * (a + b) - centre);
    if (difference < smallest) best = axis, smallest = difference;
  }
  return best;
}

// True if no tetrahedron between O and face vertices is thin or inside out: needles defeat the
// proxy. All others are thick enough wherever O is.
bool IsFat(const Decomposition& cell) {
  const TetrahedralComplex& complex = cell.complex;
  for (std::uint32_t left = complex.tetrahedra_at[kFirstInteriorVertex]; left; left &= left - 1) {
    const int t = std::countr_zero(left);
    const unsigned corners = complex.vertex_mask[t] & 0xFF;
    if (corners & (corners - 1)) continue;  // two of them
    const auto& v = complex.vertices[t];
    const Vec3& first = cell.position[v[0]];
    const Vec3 a = cell.position[v[1]] - first, b = cell.position[v[2]] - first,
               c = cell.position[v[3]] - first;
    const Vec3 ab = a.cross(b), bc = b.cross(c), ca = c.cross(a);
    const double volume = a.dot(bc);  // six times
    const double area2 = std::max({ab.squaredNorm(), bc.squaredNorm(), ca.squaredNorm(),
                                   (ab + bc + ca).squaredNorm()});  // of the largest side, twice
    if (!(volume > kLeastAltitude * std::sqrt(area2))) return false;
  }
  return true;
}

// Rule 3. Flips what O's density allows, unless that makes a tetrahedron thin.
void FlipAround(const Vec3& position, double density, Decomposition& out) {
  out.position[kFirstInteriorVertex] = position;
  out.density[kFirstInteriorVertex] = density;
  const auto is_neutral = [density](const Interval& i) {
    return i.low <= density && density <= i.high;
  };
  unsigned edges = 0, corners = 0xff;
  for (std::size_t n = 0; n < kCubeEdges.size(); ++n) {
    const CubeEdge& edge = kCubeEdges[n];
    if (is_neutral(EdgeInterval(out, edge))) {
      edges |= 1u << n;
    } else {
      corners &= ~(1u << edge.u | 1u << edge.v);
    }
  }
  for (int corner = 0; corner < 8; ++corner) {
    if (!is_neutral(CornerInterval(out, corner))) corners &= ~(1u << corner);
  }
  out.complex = kSingleComplex;
  // An edge adds a tetrahedron, a corner takes one away.
  if (24 + std::popcount(edges) - std::popcount(corners) > kMaxTetrahedra) return;
  out.complex = MakeFlippedComplex(edges, corners);
  if (!IsFat(out)) out.complex = kSingleComplex;
}

// Rule 2: returns the point on the half diagonal `towards` where F is closer to `density`.
Vec3 PlaceOnDiagonal(const Trilinear& f, const Vec3& towards, double density) {
  const Vec3 centre = Vec3::Constant(0.5);
  const Vec3 near = centre + kNearOffset * towards, far = centre + kFarOffset * towards;
  return std::abs(f.Value(far) - density) < std::abs(f.Value(near) - density) ? far : near;
}

// Rule 2. Returns false if the rule does not apply.
bool PlaceInteriorPair(const CellDensities& d, const CellSaddles& saddles,
                       const SaddlePattern& pattern, Decomposition& out) {
  const InteriorPair pair = FindInteriorPair(d, saddles, pattern);
  if (pair.corner < 0 || pair.body.count == 0) return false;
  const int a = kFirstInteriorVertex, b = a + 1;
  out.complex = kDoubleComplexes[pair.corner];
  out.body_saddle_count = pair.body.count;
  const Trilinear f(d);
  out.position[a] = PlaceOnDiagonal(f, pair.towards, pair.at_corner);
  out.position[b] = PlaceOnDiagonal(f, -pair.towards, pair.opposite);
  out.density[a] = pair.at_corner;
  out.density[b] = pair.opposite;
  return true;
}

// False only if FindFaceSaddle finds none.
bool MayHaveFaceSaddle(const CellDensities& d) {
  for (const auto& [p, q, s, t] : kFaceCorners) {
    const bool above = d[p] > d[q];
    if (above == (d[p] > d[t]) && above == (d[s] > d[q]) && above == (d[s] > d[t])) return true;
  }
  return false;
}

// Rule 1 in most cells. Without face saddles every diagonal fits, and at the centre all have the
// density of F there. What `out` has of a plain cell stays.
void DecomposePlain(const CellDensities& d, Decomposition& out) {
  std::ranges::copy(d, out.density.begin());
  for (int face = 0; face < 6; ++face) out.density[kFirstFaceVertex + face] = MeanOfFace(d, face);
  if (std::exchange(out.is_plain, true)) return;
  for (int v = 0; v < kFirstInteriorVertex; ++v) {
    out.position[v] = Vec3::Map(kPlainPositions[v].data());
  }
  out.complex = kDiamondComplexes[0];
}

}  // namespace

Interval InteriorInterval(const CellDensities& d, const CellSaddles& saddles,
                          const SaddlePattern& pattern) {
  const auto [lowest, highest] = std::minmax_element(d.begin(), d.end());
  Interval interval{*lowest, *highest};
  bool split = false;
  for (int n = 0; n < pattern.count; ++n) {
    const double value = saddles.face[pattern.face[n]].density.value();
    if (!pattern.splitting[n]) interval.low = value;
    if (pattern.splitting[n] && !split) interval.high = value, split = true;
  }
  return interval;
}

InteriorPair FindInteriorPair(const CellDensities& d, const CellSaddles& saddles,
                              const SaddlePattern& pattern) {
  InteriorPair pair;
  const unsigned low_faces = 1u << pattern.face[0] | 1u << pattern.face[1] | 1u << pattern.face[2];
  for (int corner = 0; corner < 8; ++corner) {
    if (kVertexFaces[corner] == low_faces) pair.corner = corner;
  }
  if (pair.corner < 0) return pair;
  pair.at_corner = saddles.face[pattern.face[2]].density.value();
  pair.opposite = saddles.face[pattern.face[3]].density.value();
  pair.body = FindBodySaddles(d);
  const Trilinear f(d);
  const auto& o = kCornerOffset[pair.corner];
  pair.towards = Vec3(2 * o[0] - 1, 2 * o[1] - 1, 2 * o[2] - 1);
  // O = -(ν, η, ε) / ρ. Multiplied by ρ, so that a small ρ does no harm.
  const Vec3 rho_centre(-f.nu, -f.eta, -f.epsilon);
  for (int n = 0; n < pair.body.count; ++n) {
    const Vec3 rho_offset = f.rho * pair.body.saddle[n].position - rho_centre;
    const bool at_corner = (f.rho < 0 ? -1.0 : 1.0) * rho_offset.dot(pair.towards) > 0.0;
    (at_corner ? pair.at_corner : pair.opposite) = pair.body.saddle[n].density;
  }
  return pair;
}

void DecomposeTpbcc(const CellDensities& d, Decomposition& out) {
  if (!MayHaveFaceSaddle(d)) return DecomposePlain(d, out);
  const CellSaddles saddles(d);
  if (saddles.count == 0) return DecomposePlain(d, out);
  PlaceCorners(d, out);
  out.is_plain = false;
  out.face_saddle_count = saddles.count;
  for (int face = 0; face < 6; ++face) {
    if (saddles.face[face].exists) {
      PlaceNearSaddle(face, saddles.face[face], out);
    } else {
      PlaceFaceCentre(d, face, out);
    }
  }
  const Vec3 centre = Vec3::Constant(0.5), room = Vec3::Constant(kInteriorRoom);
  const SaddlePattern pattern = ClassifySaddles(d, saddles.face);
  if (pattern.IsInterleavedSix() && PlaceInteriorPair(d, saddles, pattern, out)) return;
  if (saddles.count <= 4) {
    const BodySaddles body = FindBodySaddles(d);
    out.body_saddle_count = body.count;
    if (body.count > 0) {
      const Vec3& at = body.saddle[0].position;
      return FlipAround(at.cwiseMax(centre - room).cwiseMin(centre + room), body.saddle[0].density,
                        out);
    }
  }
  const Interval interval = InteriorInterval(d, saddles, pattern);
  if (const int axis = FindDiagonal(d, interval, saddles.count, out); axis >= 0) {
    out.complex = kDiamondComplexes[axis];
    return;
  }
  const double margin = kIntervalShare * (interval.high - interval.low);
  const double density =
      std::max(interval.low + margin, std::min(MeanOfCell(d), interval.high - margin));
  FlipAround(centre, density, out);
}

}  // namespace palpate
