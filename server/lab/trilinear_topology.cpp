#include "server/lab/trilinear_topology.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "common/error/error.h"
#include "common/isosurface/cell.h"

namespace palpate::lab {
namespace {

// Finds critical points of the trilinear interpolant and judges them in quadruple precision.
//
// Resolved ties (cell.h) differ by 1e-8 and less, and products of such differences decide at a
// saddle between them. In double precision, a count over a tied volume goes wrong. Densities are
// taken as exact; the results are only signs. This code is independent of
// common/isosurface/saddles.h and serves to check it.
//
// Frame: index coordinates local to the cell. Threads: pure functions. Slow: some microseconds for
// a body saddle.

struct BodyCritical {
  bool above;                 // F there is above the isovalue
  bool positive_determinant;  // of the Hessian
};

struct BodyCriticals {
  int count = 0;
  std::array<BodyCritical, 2> point;
};

struct FaceCritical {
  bool exists = false;  // strictly inside the face
  bool above = false;
  // F rises from the face into the cell behind it, into the cell in front of it
  std::array<bool, 2> rises{};
};

using Wide = __float128;

Wide SquareRoot(Wide x) {
  Wide root = std::sqrt(static_cast<double>(x));
  // Newton's method: each step doubles the number of correct digits.
  for (int step = 0; step < 2 && root > 0; ++step) root = (root + x / root) / 2;
  return root;
}

bool IsWithin(Wide x) { return x > 0 && x < 1; }

// A derivative has no zero if its values on the four edges along its axis have the same sign. Then
// F has no critical point.
bool IsMonotone(const CellDensities& d) {
  constexpr int kEdges[3][4][2] = {{{0, 3}, {4, 7}, {1, 2}, {5, 6}},
                                   {{0, 4}, {3, 7}, {1, 5}, {2, 6}},
                                   {{0, 1}, {3, 2}, {4, 5}, {7, 6}}};
  for (const auto& axis : kEdges) {
    int rising = 0, falling = 0;
    for (const auto& [from, to] : axis) {
      rising += d[to] > d[from];
      falling += d[to] < d[from];
    }
    if (rising == 4 || falling == 4) return true;
  }
  return false;
}

// Coefficients of F, as in Trilinear.
struct WideTrilinear {
  Wide alpha, beta, gamma, delta, epsilon, eta, nu, rho;

  explicit WideTrilinear(const CellDensities& density) {
    std::array<Wide, 8> d;
    for (int v = 0; v < 8; ++v) d[v] = density[v];
    alpha = d[0];
    beta = d[3] - d[0];
    gamma = d[4] - d[0];
    delta = d[1] - d[0];
    epsilon = d[7] - d[4] - beta;
    eta = d[2] - d[1] - beta;
    nu = d[5] - d[4] - delta;
    rho = d[6] - d[5] - (d[7] - d[4]) - eta;
  }
};

// Zeros of ∇F strictly inside the cell.
BodyCriticals FindBodyCriticals(const CellDensities& d, double isovalue) {
  BodyCriticals found;
  if (IsMonotone(d)) return found;
  const WideTrilinear f(d);
  // Eliminating y and z from ∇F = 0 leaves a quadratic in x: a2 x² + 2 a1 x + a0.
  const Wide b = f.beta * f.rho - f.epsilon * f.eta;
  const Wide a2 = f.rho * b;
  const Wide a1 = f.nu * b;
  const Wide a0 = f.nu * f.nu * f.beta + f.gamma * f.delta * f.rho -
                  f.nu * (f.gamma * f.eta + f.delta * f.epsilon);
  const Wide discriminant = a1 * a1 - a2 * a0;
  if (discriminant < 0) return found;
  const Wide root = SquareRoot(discriminant);
  const Wide q = a1 < 0 ? root - a1 : -(a1 + root);
  for (const Wide x : {q / a2, a0 / q}) {
    const Wide yz = f.nu + f.rho * x;
    const Wide y = -(f.delta + f.eta * x) / yz;
    const Wide z = -(f.gamma + f.epsilon * x) / yz;
    if (!IsWithin(x) || !IsWithin(y) || !IsWithin(z)) continue;
    const Wide value = f.alpha + f.beta * x + f.gamma * y + f.delta * z + f.epsilon * x * y +
                       f.eta * x * z + f.nu * y * z + f.rho * x * y * z;
    const Wide half_determinant = (f.epsilon + f.rho * z) * (f.eta + f.rho * y) * yz;
    found.point[found.count++] = {value > isovalue, half_determinant > 0};
  }
  return found;
}

// The saddle of a face with corners p, q, s, t in cyclic order. `behind` and `front` are the
// opposite corners in the cells on the two sides.
FaceCritical FindFaceCritical(const std::array<double, 4>& face,
                              const std::array<double, 4>& behind,
                              const std::array<double, 4>& front, double isovalue) {
  FaceCritical found;
  const auto& [p, q, s, t] = face;
  const bool up = p > q && p > t && s > q && s > t;
  const bool down = p < q && p < t && s < q && s < t;
  if (!up && !down) return found;
  found.exists = true;
  const Wide tau = isovalue;
  const Wide product = (p - tau) * (s - tau) - (q - tau) * (t - tau);
  found.above = up ? product > 0 : product < 0;
  // Bilinear weights of the corners at the saddle, times the square of p + s - q - t.
  const Wide pq = Wide(p) - q, pt = Wide(p) - t, sq = Wide(s) - q, st = Wide(s) - t;
  const Wide weight[4] = {sq * st, pt * st, pt * pq, sq * pq};
  for (int side = 0; side < 2; ++side) {
    Wide slope = 0;
    for (int n = 0; n < 4; ++n) slope += weight[n] * (Wide((side ? front : behind)[n]) - face[n]);
    found.rises[side] = slope > 0;
  }
  return found;
}

// χ of the subcomplex of the octahedron that a set of its vertices spans. Bit 2 * axis + side is
// the vertex on this side of the axis.
constexpr std::array<std::int8_t, 64> kOctahedronEuler = [] {
  std::array<std::int8_t, 64> euler{};
  for (unsigned set = 0; set < 64; ++set) {
    // Faces of the octahedron are sets without opposite vertices.
    for (unsigned simplex = 1; simplex < 64; ++simplex) {
      const bool opposite = (simplex & simplex >> 1 & 0b010101) != 0;
      if (opposite || (simplex & set) != simplex) continue;
      euler[set] = static_cast<std::int8_t>(euler[set] + (std::popcount(simplex) % 2 ? 1 : -1));
    }
  }
  return euler;
}();
static_assert(kOctahedronEuler[0] == 0 && kOctahedronEuler[1] == 1 && kOctahedronEuler[3] == 2 &&
              kOctahedronEuler[15] == 0 && kOctahedronEuler[63] == 2);

// Counts for the solid {F > τ}. With `below`, counts for {F < τ}, and "up" means down.
class Counter {
 public:
  Counter(const VolumeSnapshot& volume, double isovalue, bool below)
      : volume_(volume), isovalue_(isovalue), below_(below) {}

  bool IsInside(double density) const { return (density > isovalue_) != below_; }

  // Adds the cell's low corner, its three low faces and its interior.
  void AddCell(const Vec3i& cell, MorseCount& count) const {
    const CellDensities d = volume_.ResolvedCell(cell);
    if (std::none_of(d.begin(), d.end(), [&](double x) { return IsInside(x); })) return;
    if (IsInside(d[0])) Add(1 - VertexLink(cell, d), count.vertices, count);
    for (int axis = 0; axis < 3; ++axis) Add(FaceTerm(cell, axis, d), count.face_saddles, count);
    const BodyCriticals body = FindBodyCriticals(d, isovalue_);
    for (int n = 0; n < body.count; ++n) Add(BodyTerm(body.point[n]), count.body_saddles, count);
  }

 private:
  static void Add(int term, std::int64_t& kind, MorseCount& count) {
    kind += term != 0;
    count.solid += term;
  }

  bool IsUp(double from, double to) const { return (to > from) != below_; }

  int VertexLink(const Vec3i& vertex, const CellDensities& d) const {
    unsigned up = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const Vec3i step = Vec3i::Unit(axis);
      const double high = d[CornerAt(step.x(), step.y(), step.z())];
      const double low = volume_.ResolvedVertex(vertex - step);
      up |= static_cast<unsigned>(IsUp(d[0], low)) << (2 * axis);
      up |= static_cast<unsigned>(IsUp(d[0], high)) << (2 * axis + 1);
    }
    return kOctahedronEuler[up];
  }

  // The face at the cell's low end of the axis.
  int FaceTerm(const Vec3i& cell, int axis, const CellDensities& d) const {
    std::array<double, 4> face, behind, front;
    for (int n = 0; n < 4; ++n) {
      face[n] = d[kFaceCorners[2 * axis][n]];
      front[n] = d[kFaceCorners[2 * axis + 1][n]];
    }
    if (std::none_of(face.begin(), face.end(), [&](double x) { return IsInside(x); })) return 0;
    for (int n = 0; n < 4; ++n) {
      const auto& o = kCornerOffset[kFaceCorners[2 * axis][n]];
      behind[n] = volume_.ResolvedVertex(cell + Vec3i(o[0], o[1], o[2]) - Vec3i::Unit(axis));
    }
    const FaceCritical saddle = FindFaceCritical(face, behind, front, isovalue_);
    if (!saddle.exists || saddle.above == below_) return 0;
    return (saddle.rises[0] != below_) + (saddle.rises[1] != below_) - 1;
  }

  int BodyTerm(const BodyCritical& saddle) const {
    if (saddle.above == below_) return 0;
    return saddle.positive_determinant != below_ ? -1 : 1;
  }

  const VolumeSnapshot& volume_;
  const double isovalue_;
  const bool below_;
};

// True if the border is above the isovalue, false if below. Throws if parts are on both sides.
bool IsBorderAbove(const VolumeSnapshot& volume, double isovalue, const CellRange& range) {
  bool above = false, below = false;
  for (int i = range.first.x(); i <= range.end.x(); ++i) {
    for (int j = range.first.y(); j <= range.end.y(); ++j) {
      const bool inner =
          i != range.first.x() && i != range.end.x() && j != range.first.y() && j != range.end.y();
      const int step = inner ? range.end.z() - range.first.z() : 1;
      for (int k = range.first.z(); k <= range.end.z(); k += step) {
        (volume.ResolvedVertex(Vec3i(i, j, k)) > isovalue ? above : below) = true;
      }
    }
  }
  if (above && below) {
    throw Error(ErrorKind::kInvalidArgument,
                "the isosurface meets the border of the cells: it is not closed there");
  }
  return above;
}

}  // namespace

MorseCount CountTrilinearTopology(const VolumeSnapshot& volume, double isovalue,
                                  const CellRange& range) {
  const Counter counter(volume, isovalue, IsBorderAbove(volume, isovalue, range));
  return tbb::parallel_reduce(
      tbb::blocked_range<int>(range.first.x(), range.end.x()), MorseCount{},
      [&](const tbb::blocked_range<int>& layers, MorseCount count) {
        for (int i = layers.begin(); i < layers.end(); ++i) {
          for (int j = range.first.y(); j < range.end.y(); ++j) {
            for (int k = range.first.z(); k < range.end.z(); ++k) {
              counter.AddCell(Vec3i(i, j, k), count);
            }
          }
        }
        return count;
      },
      [](MorseCount l, const MorseCount& r) {
        l.vertices += r.vertices;
        l.face_saddles += r.face_saddles;
        l.body_saddles += r.body_saddles;
        l.solid += r.solid;
        return l;
      });
}

}  // namespace palpate::lab
