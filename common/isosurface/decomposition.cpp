#include "common/isosurface/decomposition.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/isosurface/saddles.h"

namespace palpate {
namespace {

// Vertices off the corners keep this distance from the border of their face or
// cell: the smallest altitude of any tetrahedron is then 0.118 of the cell.
constexpr double kInset = 0.3;
// Interior vertices of the double complex: ½ ± this on a diagonal of the cell.
constexpr double kDiagonalOffset = 0.15;
// Where in its interval an assigned density lies, from the nearer end.
constexpr double kIntervalShare = 0.25;
constexpr int kNewtonSteps = 4;

constexpr void AddTetrahedron(TetrahedralComplex& complex, int a, int b, int c, int d) {
  const int n = complex.tetrahedron_count++;
  const int vertices[4] = {a, b, c, d};
  for (int v = 0; v < 4; ++v) {
    complex.vertices[n][v] = static_cast<std::uint8_t>(vertices[v]);
    complex.vertex_mask[n] |= static_cast<std::uint16_t>(1u << vertices[v]);
  }
}

// The apex of each face is joined to the 4 triangles around its face vertex.
constexpr void AddFacePyramids(TetrahedralComplex& complex, const std::array<int, 6>& apex) {
  for (int face = 0; face < 6; ++face) {
    const auto& corners = kFaceCorners[face];
    for (int n = 0; n < 4; ++n) {
      AddTetrahedron(complex, apex[face], kFirstFaceVertex + face, corners[n],
                     corners[(n + 1) % 4]);
    }
  }
}

constexpr TetrahedralComplex MakeSingleComplex() {
  TetrahedralComplex complex;
  complex.vertex_count = 15;
  std::array<int, 6> apex{};
  apex.fill(kFirstInteriorVertex);
  AddFacePyramids(complex, apex);
  return complex;
}

// Vertex a (14) serves the faces at `corner`, b (15) the others; the 6 cube
// edges that touch neither `corner` nor its opposite are joined to both.
constexpr TetrahedralComplex MakeDoubleComplex(int corner) {
  const int a = kFirstInteriorVertex, b = a + 1;
  TetrahedralComplex complex;
  complex.vertex_count = 16;
  std::array<int, 6> apex{};
  for (int face = 0; face < 6; ++face) {
    apex[face] = kVertexFaces[corner] >> face & 1 ? a : b;
  }
  AddFacePyramids(complex, apex);
  const auto& o = kCornerOffset[corner];
  const int opposite = CornerAt(1 - o[0], 1 - o[1], 1 - o[2]);
  for (int u = 0; u < 8; ++u) {
    for (int v = u + 1; v < 8; ++v) {
      int differing = 0;
      for (int axis = 0; axis < 3; ++axis) {
        differing += kCornerOffset[u][axis] != kCornerOffset[v][axis];
      }
      if (differing != 1) continue;
      if (u == corner || v == corner || u == opposite || v == opposite) continue;
      AddTetrahedron(complex, a, b, u, v);
    }
  }
  return complex;
}

constexpr TetrahedralComplex kSingleComplex = MakeSingleComplex();
constexpr std::array<TetrahedralComplex, 8> kDoubleComplexes = [] {
  std::array<TetrahedralComplex, 8> complexes{};
  for (int corner = 0; corner < 8; ++corner) complexes[corner] = MakeDoubleComplex(corner);
  return complexes;
}();

double Mean4(double p, double q, double s, double t) { return ((p + s) + (q + t)) * 0.25; }

double MeanOf(const CellDensities& d) {
  return (Mean4(d[0], d[3], d[2], d[1]) + Mean4(d[4], d[7], d[6], d[5])) * 0.5;
}

double ClampInset(double x) { return std::clamp(x, kInset, 1.0 - kInset); }

Vec3 ClampInset(const Vec3& p) { return {ClampInset(p.x()), ClampInset(p.y()), ClampInset(p.z())}; }

void PlaceCorners(const CellDensities& d, Decomposition& out) {
  for (int v = 0; v < 8; ++v) {
    out.position[v] = Vec3(kCornerOffset[v][0], kCornerOffset[v][1], kCornerOffset[v][2]);
    out.density[v] = d[v];
  }
}

Vec3 OnFace(int face, double b, double c) {
  const int axis = face / 2;
  Vec3 p;
  p[axis] = face % 2;
  p[axis == 0 ? 1 : 0] = b;
  p[axis == 2 ? 1 : 2] = c;
  return p;
}

// F is constant along the two lattice lines through the saddle: the nearer of
// their points to the centre has the saddle's density and a better shape.
void PlaceFaceVertex(const CellDensities& d, int face, const FaceSaddle& saddle,
                     Decomposition& out) {
  const int v = kFirstFaceVertex + face;
  if (!saddle.exists) {
    const auto& k = kFaceCorners[face];
    out.position[v] = OnFace(face, 0.5, 0.5);
    out.density[v] = Mean4(d[k[0]], d[k[1]], d[k[2]], d[k[3]]);
    return;
  }
  const bool keep_b = std::abs(saddle.b - 0.5) <= std::abs(saddle.c - 0.5);
  out.position[v] =
      keep_b ? OnFace(face, ClampInset(saddle.b), 0.5) : OnFace(face, 0.5, ClampInset(saddle.c));
  out.density[v] = saddle.density.value();
}

struct Interval {
  double low, high;
  bool Contains(double x) const { return low < x && x < high; }
};

// Between the last joining and the first splitting saddle (rule 1).
Interval InteriorInterval(const CellDensities& d, const std::array<FaceSaddle, 6>& saddles,
                          const SaddlePattern& pattern) {
  Interval interval{*std::min_element(d.begin(), d.end()), *std::max_element(d.begin(), d.end())};
  bool split = false;
  for (int n = 0; n < pattern.count; ++n) {
    const double value = saddles[pattern.face[n]].density.value();
    if (!pattern.splitting[n]) interval.low = value;
    if (pattern.splitting[n] && !split) interval.high = value, split = true;
  }
  return interval;
}

// The centre where F there is within the interval; otherwise a point walked
// towards it along ∇F, given a density within where F still is not.
void PlaceInInterval(const CellDensities& d, const Interval& interval, Decomposition& out) {
  const int v = kFirstInteriorVertex;
  Vec3 p = Vec3::Constant(0.5);
  double value = MeanOf(d);
  if (!interval.Contains(value)) {
    const double width = interval.high - interval.low;
    const double target = value <= interval.low ? interval.low + kIntervalShare * width
                                                : interval.high - kIntervalShare * width;
    const Trilinear f(d);
    for (int step = 0; step < kNewtonSteps && !interval.Contains(value); ++step) {
      const Vec3 gradient = f.Gradient(p);
      const double norm2 = gradient.squaredNorm();
      if (!(norm2 > 0.0)) break;
      p = ClampInset(Vec3(p + gradient * ((target - value) / norm2)));
      value = f.Value(p);
    }
    if (!interval.Contains(value)) value = target;
  }
  out.position[v] = p;
  out.density[v] = value;
}

// Corner shared by the three faces of a bit mask.
std::optional<int> SharedCorner(std::uint8_t faces) {
  for (int corner = 0; corner < 8; ++corner) {
    if (kVertexFaces[corner] == faces) return corner;
  }
  return std::nullopt;
}

// Rule 3. Returns false where the three lowest faces share no corner, which
// exact arithmetic excludes.
bool PlaceTwoInterior(const CellDensities& d, const std::array<FaceSaddle, 6>& saddles,
                      const SaddlePattern& pattern, Decomposition& out) {
  const auto low_faces = static_cast<std::uint8_t>(1u << pattern.face[0] | 1u << pattern.face[1] |
                                                   1u << pattern.face[2]);
  const std::optional<int> corner = SharedCorner(low_faces);
  if (!corner) return false;
  const int a = kFirstInteriorVertex, b = a + 1;
  const auto& o = kCornerOffset[*corner];
  const Vec3 towards(o[0] - 0.5, o[1] - 0.5, o[2] - 0.5);  // half a diagonal
  out.complex = &kDoubleComplexes[*corner];
  out.position[a] = Vec3::Constant(0.5) + 2.0 * kDiagonalOffset * towards;
  out.position[b] = Vec3::Constant(0.5) - 2.0 * kDiagonalOffset * towards;
  out.density[a] = saddles[pattern.face[2]].density.value();
  out.density[b] = saddles[pattern.face[3]].density.value();

  const Trilinear f(d);
  const BodySaddles body = FindBodySaddles(d);
  out.body_saddle_count = body.count;
  // O = -(ν, η, ε) / ρ; multiplied by ρ so that a small one does no harm.
  const Vec3 rho_centre(-f.nu, -f.eta, -f.epsilon);
  for (int n = 0; n < body.count; ++n) {
    const Vec3 rho_offset = f.rho * body.saddle[n].position - rho_centre;
    const bool at_corner = (f.rho < 0 ? -1.0 : 1.0) * rho_offset.dot(towards) > 0.0;
    out.density[at_corner ? a : b] = body.saddle[n].density;
  }
  return true;
}

void DecomposeTpbcc(const CellDensities& d, Decomposition& out) {
  std::array<FaceSaddle, 6> saddles;
  for (int face = 0; face < 6; ++face) {
    const auto& k = kFaceCorners[face];
    saddles[face] = FindFaceSaddle(d[k[0]], d[k[1]], d[k[2]], d[k[3]]);
    PlaceFaceVertex(d, face, saddles[face], out);
    out.face_saddle_count += saddles[face].exists;
  }
  out.body_saddle_count = 0;
  SaddlePattern pattern;
  if (out.face_saddle_count > 0) {
    pattern = ClassifySaddles(d, saddles);
    if (pattern.IsInterleavedSix() && PlaceTwoInterior(d, saddles, pattern, out)) return;
    if (out.face_saddle_count <= 4) {
      const BodySaddles body = FindBodySaddles(d);
      out.body_saddle_count = body.count;
      if (body.count > 0) {
        out.position[kFirstInteriorVertex] = ClampInset(body.saddle[0].position);
        out.density[kFirstInteriorVertex] = body.saddle[0].density;
        return;
      }
    }
  }
  PlaceInInterval(d, InteriorInterval(d, saddles, pattern), out);
}

void DecomposeBcc(const CellDensities& d, Decomposition& out) {
  for (int face = 0; face < 6; ++face) PlaceFaceVertex(d, face, FaceSaddle{}, out);
  out.position[kFirstInteriorVertex] = Vec3::Constant(0.5);
  out.density[kFirstInteriorVertex] = MeanOf(d);
  out.body_saddle_count = -1;
}

}  // namespace

Decomposition Decompose(const CellDensities& d, DecompositionMethod method) {
  Decomposition out;
  out.complex = &kSingleComplex;
  PlaceCorners(d, out);
  if (method == DecompositionMethod::kBcc) {
    DecomposeBcc(d, out);
  } else {
    DecomposeTpbcc(d, out);
  }
  return out;
}

}  // namespace palpate
