#include "server/haptics/visual_proxy.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "server/haptics/moves.h"

namespace palpate {
namespace {

// A density within this share of the range from τ counts as on V.
constexpr double kOnSurface = 1e-12;
// The same, where the line only touches V.
constexpr double kTangent = 1e-9;
// Roots are refined to this many voxels.
constexpr double kRootTolerance = 1e-10;
// Unit normals with a shorter mean than this cancel out.
constexpr double kNoDirection = 1e-6;
constexpr int kMaxRefinements = 80;
constexpr int kMaxQuickSteps = 6;
constexpr int kMaxCells = 24;

// Turns a covector of L or I into a direction in D.
Vec3 CovectorToDevice(const AffineMap& X_LD, const Vec3& gradient_L) {
  return X_LD.linear.transpose() * gradient_L;
}

// F in a cell of the voxels. It is the same for every refinement.
Trilinear InVoxels(const HapticSurface& surface, const Vec3i& cell) {
  return Trilinear(surface.Felt(surface.volume->StoredCell(cell)));
}

void FillSurfacePiece(const HapticSurface& surface, const HapticCell& cell, int tetrahedron,
                      SurfacePiece& piece) {
  piece.tetrahedron = tetrahedron;
  piece.isovalue = surface.isovalue;
  std::array<CutEdge, 4> cuts;
  piece.count = cell.CutEdges(tetrahedron, surface.isovalue, cuts);
  const Trilinear f(cell.densities);
  for (int n = 0; n < piece.count; ++n) {
    SurfacePiece::Corner& corner = piece.corners[n];
    corner.local = cuts[n].Between(cell.parts.position);
    corner.normal_D = -CovectorToDevice(surface.X_LD, f.Gradient(corner.local)).normalized();
  }
}

const SurfacePiece& PieceIn(const HapticSurface& surface, HapticCell& cell, int tetrahedron) {
  if (cell.piece.tetrahedron != tetrahedron || cell.piece.isovalue != surface.isovalue) {
    FillSurfacePiece(surface, cell, tetrahedron, cell.piece);
  }
  return cell.piece;
}

// Barycentric weights of p in a triangle. p must lie in its plane, up to rounding.
Vec3 TriangleWeights(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& p) {
  const Vec3 normal = (b - a).cross(c - a);
  const double area2 = normal.squaredNorm();
  const double v = (p - a).cross(c - a).dot(normal) / area2;
  const double w = (b - a).cross(p - a).dot(normal) / area2;
  return {1.0 - v - w, v, w};
}

Vec3 InterpolatedNormal(const SurfacePiece& piece, const Vec3& local) {
  Vec3 best_normal = Vec3::Zero();
  double best = -std::numeric_limits<double>::infinity();
  for (int n = 1; n + 1 < piece.count; ++n) {
    const auto &a = piece.corners[0], &b = piece.corners[n], &c = piece.corners[n + 1];
    const Vec3 weights = TriangleWeights(a.local, b.local, c.local, local);
    if (!weights.allFinite() || weights.minCoeff() <= best) continue;
    best = weights.minCoeff();
    const Vec3 w = weights.cwiseMax(0.0).cwiseMin(1.0);
    best_normal = w[0] * a.normal_D + w[1] * b.normal_D + w[2] * c.normal_D;
    if (best >= 0.0) break;
  }
  return best_normal;
}

// n_E at the proxy, or the facet's own normal where the interpolated one vanishes.
Vec3 LineDirection(const HapticSurface& surface, const Place& place, const Vec3& local,
                   HapticCell& cell, CellCache& cache) {
  Vec3 facet = Vec3::Zero();
  for (std::uint32_t left = TetrahedraAt(cell.parts.complex, place.carrier); left;
       left &= left - 1) {
    const int t = std::countr_zero(left);
    const SurfacePiece& piece = PieceIn(surface, cell, t);
    if (piece.count < 3) continue;
    const Vec3 normal = InterpolatedNormal(piece, local);
    if (normal.allFinite() && normal.norm() > kNoDirection) return normal.normalized();
    facet = cache.Gradients(cell, t).fall.normal;
  }
  return facet.norm() > 0.0 ? Vec3(facet.normalized()) : facet;
}

// F - τ along p + s u within a cell.
struct LineCubic {
  double c0, c1, c2, c3;

  LineCubic(const Trilinear& f, const Vec3& p, const Vec3& u, double isovalue)
      : c0(f.Value(p) - isovalue),
        c1(f.Gradient(p).dot(u)),
        c2(f.epsilon * u.x() * u.y() + f.eta * u.x() * u.z() + f.nu * u.y() * u.z() +
           f.rho * (p.x() * u.y() * u.z() + p.y() * u.x() * u.z() + p.z() * u.x() * u.y())),
        c3(f.rho * u.x() * u.y() * u.z()) {}

  double operator()(double s) const { return c0 + s * (c1 + s * (c2 + s * c3)); }
  double Slope(double s) const { return c1 + s * (2.0 * c2 + s * 3.0 * c3); }

  // Stationary points in (0, end), ascending.
  int Stationary(double end, double out[2]) const {
    const double a = 3.0 * c3, b = c2;  // a s² + 2 b s + c1
    const double discriminant = b * b - a * c1;
    if (discriminant < 0.0) return 0;
    const double q = -(b + std::copysign(std::sqrt(discriminant), b));
    const double roots[2] = {q / a, c1 / q};
    int count = 0;
    for (double s : roots) {
      if (s > 0.0 && s < end) out[count++] = s;  // false for NaN and infinities
    }
    if (count == 2 && out[0] > out[1]) std::swap(out[0], out[1]);
    return count;
  }
};

// Finds the root in [a, b], where f changes its sign, with Newton's method kept within the bracket.
double Refine(const LineCubic& f, double a, double b, double tolerance) {
  const bool rising = f(b) > 0.0;
  double s = 0.5 * (a + b);
  for (int n = 0; n < kMaxRefinements && b - a > tolerance; ++n) {
    const double value = f(s);
    if (value == 0.0) return s;
    ((value > 0.0) == rising ? b : a) = s;
    double next = s - value / f.Slope(s);
    if (!(next > a && next < b)) next = 0.5 * (a + b);
    if (std::abs(next - s) < 0.5 * tolerance) return next;
    s = next;
  }
  return s;
}

// Returns the first root in [0, end], or a negative value if there is none.
double FirstRoot(const LineCubic& f, double end, double tolerance) {
  if (std::abs(f(0.0)) <= kOnSurface) return 0.0;
  double stop[4] = {0.0};
  int stops = 1 + f.Stationary(end, stop + 1);
  const int stationary = stops;
  stop[stops++] = end;
  for (int n = 1; n < stops; ++n) {
    const double before = f(stop[n - 1]), after = f(stop[n]);
    if (before * after < 0.0) return Refine(f, stop[n - 1], stop[n], tolerance);
    const double near = n < stationary ? kTangent : kOnSurface;
    if (std::abs(after) <= near) return stop[n];
  }
  return -1.0;
}

struct Root {
  double s = -1.0;  // mm along the line; negative: none
  Vec3 p_I = Vec3::Zero();
  Vec3 gradient_I = Vec3::Zero();
};

// Follows p_I + s u_I, with s in [0, reach_mm], starting in `cell`.
Root FollowLine(const HapticSurface& surface, Vec3i cell, Vec3 p_I, const Vec3& u_I,
                double reach_mm) {
  Root root;
  double travelled = 0.0;
  for (int n = 0; n < kMaxCells && travelled < reach_mm && surface.volume->HasCell(cell); ++n) {
    double end = reach_mm - travelled;
    int axis_out = -1;
    for (int axis = 0; axis < 3; ++axis) {
      if (u_I[axis] == 0.0) continue;
      const double border = cell[axis] + (u_I[axis] > 0.0 ? 1.0 : 0.0);
      const double s = std::max(0.0, (border - p_I[axis]) / u_I[axis]);
      if (s < end) end = s, axis_out = axis;
    }
    const Trilinear f = InVoxels(surface, cell);
    const Vec3 local = p_I - cell.cast<double>();
    const LineCubic cubic(f, local, u_I, surface.isovalue);
    const double s = FirstRoot(cubic, end, kRootTolerance / u_I.norm());
    if (s >= 0.0) {
      root.s = travelled + s;
      root.p_I = p_I + s * u_I;
      root.gradient_I = f.Gradient(local + s * u_I);
      return root;
    }
    if (axis_out < 0) break;
    travelled += end;
    p_I += end * u_I;
    p_I[axis_out] = cell[axis_out] + (u_I[axis_out] > 0.0 ? 1.0 : 0.0);
    cell[axis_out] += u_I[axis_out] > 0.0 ? 1 : -1;
  }
  return root;
}

// How far it is from p_I along u_I to the padded lattice, in mm; 0 within it, infinite beside it.
double WayToLattice(const HapticSurface& surface, const Vec3& p_I, const Vec3& u_I) {
  double enter = 0.0, leave = kUnbounded;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = -1.0 - p_I[axis], high = surface.volume->size()[axis] - p_I[axis];
    if (u_I[axis] == 0.0) {
      if (low > 0.0 || high < 0.0) return kUnbounded;
      continue;
    }
    enter = std::max(enter, std::min(low / u_I[axis], high / u_I[axis]));
    leave = std::min(leave, std::max(low / u_I[axis], high / u_I[axis]));
  }
  return enter <= leave ? enter : kUnbounded;
}

struct Start {
  Vec3i cell;
  Vec3 p_I, local;
  Trilinear f;
  double excess;  // F - τ there
};

// The usual case: the nearest root is in SCP_H's own cell, and F is monotone up to the root on both
// sides, so that no other root is nearer. Negative s: this case does not apply.
Root NearbyRoot(const HapticSurface& surface, const Start& start, const Vec3& u_I) {
  const LineCubic cubic(start.f, start.local, u_I, surface.isovalue);
  const double tolerance = kRootTolerance / u_I.norm();
  Root root;
  double s = 0.0;
  for (int n = 0; n < kMaxQuickSteps; ++n) {
    const double step = cubic(s) / cubic.Slope(s);
    s -= step;
    if (!(std::abs(step) > tolerance)) break;
    if (n + 1 == kMaxQuickSteps) return root;
  }
  const double reach = std::abs(s);
  const bool monotone =
      std::abs(cubic.c1) > reach * (2.0 * std::abs(cubic.c2) + reach * 3.0 * std::abs(cubic.c3));
  const Vec3 local = start.local + s * u_I;
  // The condition is false for NaN.
  if (!monotone || !((local.array() >= 0.0).all() && (local.array() <= 1.0).all())) return root;
  root.s = reach;
  root.p_I = start.p_I + s * u_I;
  root.gradient_I = start.f.Gradient(local);
  return root;
}

// Follows the line both ways, first the way that F's value suggests. Returns the nearer root.
Root NearestRoot(const HapticSurface& surface, const Start& start, const Vec3& direction_D) {
  Vec3 u_I = surface.X_ID.linear * direction_D;
  const Root nearby = NearbyRoot(surface, start, u_I);
  if (nearby.s >= 0.0) return nearby;
  if (start.excess < 0.0) u_I = -u_I;
  const double reach_mm = kVisualReachVoxels * surface.longest_voxel_mm;
  const Root first = FollowLine(surface, start.cell, start.p_I, u_I, reach_mm);
  const double left_mm = first.s < 0.0 ? reach_mm : first.s;
  const Root second = FollowLine(surface, start.cell, start.p_I, -u_I, left_mm);
  return second.s < 0.0 ? first : second;
}

// Directions to try after n_E. In a crease of H, the normal of one facet can point across a slit of
// V and miss V. The others are the normals of V's density in the cells that hold SCP_H, their mean
// first, and the contact normal. The last lead to the vertices around SCP_H: these lie on both
// sides of V, so that one of the lines meets it.
struct Directions {
  std::array<Vec3, 14> D;
  int count = 0;

  void Add(const Vec3& direction) {
    if (direction.allFinite() && direction.norm() > 0.0) D[count++] = direction.normalized();
  }
};

Directions FallbackDirections(const HapticSurface& surface, const Place& place,
                              const HapticCell& cell, const Vec3& p_I,
                              const Vec3& contact_normal_D) {
  std::array<Vec3, 8> normals;
  int cells = 0;
  Vec3 sum = Vec3::Zero();
  VisitNeighbours(place.faces, [&](const Vec3i& offset) {
    const Vec3i voxels = surface.lattice.PartOf(place.cell + offset).voxel_cell;
    if (!surface.volume->HasCell(voxels)) return;
    const Vec3 gradient_I = InVoxels(surface, voxels).Gradient(p_I - voxels.cast<double>());
    const Vec3 normal = -CovectorToDevice(surface.X_ID, gradient_I);
    if (!(normal.norm() > 0.0)) return;
    normals[cells] = normal.normalized();
    sum += normals[cells++];
  });
  Directions directions;
  directions.Add(sum);
  for (int n = 0; n < cells; ++n) directions.Add(normals[n]);
  directions.Add(contact_normal_D);
  // Older recordings, all at refinement 1, lack SCP_V there, and are compared bit for bit.
  if (surface.lattice.refinement() == 1) return directions;
  const Vec3 from_mm = PositionIn(cell, place.carrier) - cell.origin_mm;
  place.carrier.Visit(
      [&](int n) { directions.Add(cell.vertex_mm[place.carrier.vertex[n]] - from_mm); });
  return directions;
}

}  // namespace

VisualProxy FindVisualProxy(const HapticSurface& surface, const Place& place,
                            const Vec3& contact_normal_D, CellCache& cache) noexcept {
  VisualProxy visual;
  HapticCell& cell = cache.Decomposed(surface, place.cell);
  const Vec3 local_L = LocalPosition(cell, place.carrier);
  const Vec3 p_I = surface.lattice.ToVoxels(place.cell.cast<double>() + local_L);
  const Vec3i voxels = surface.lattice.PartOf(place.cell).voxel_cell;
  const Trilinear f = InVoxels(surface, voxels);
  const Vec3 local = surface.lattice.InVoxelCell(place.cell, local_L);
  const Start start{voxels, p_I, local, f, f.Value(local) - surface.isovalue};
  const Vec3 n_E = LineDirection(surface, place, local_L, cell, cache);
  Root root;
  if (!n_E.isZero()) root = NearestRoot(surface, start, n_E);
  if (root.s < 0.0) {
    const Directions others = FallbackDirections(surface, place, cell, p_I, contact_normal_D);
    for (int n = 0; n < others.count && root.s < 0.0; ++n) {
      root = NearestRoot(surface, start, others.D[n]);
    }
  }
  if (root.s < 0.0) return visual;
  visual.found = true;
  visual.p_DV_mm = surface.X_DI.Apply(root.p_I);
  const Vec3 gradient = CovectorToDevice(surface.X_ID, root.gradient_I);
  visual.normal_D = gradient.norm() > 0.0 ? Vec3(-gradient.normalized()) : contact_normal_D;
  return visual;
}

VisualProxy FirstOnWay(const HapticSurface& surface, const Vec3& from_D_mm, const Vec3& direction_D,
                       double reach_mm) noexcept {
  const Vec3 u_I = surface.X_ID.linear * direction_D;
  Vec3 p_I = surface.X_ID.Apply(from_D_mm);
  const double out_mm = WayToLattice(surface, p_I, u_I);
  if (!(out_mm <= reach_mm)) return {};
  p_I += out_mm * u_I;
  const Vec3i cell = p_I.array().floor().cast<int>();
  const Root root =
      FollowLine(surface, cell.cwiseMax(-1).cwiseMin(surface.volume->size() - Vec3i::Ones()), p_I,
                 u_I, reach_mm - out_mm);
  if (root.s < 0.0) return {};
  const Vec3 gradient = CovectorToDevice(surface.X_ID, root.gradient_I);
  return {true, surface.X_DI.Apply(root.p_I),
          gradient.norm() > 0.0 ? Vec3(-gradient.normalized()) : Vec3(Vec3::Zero())};
}

}  // namespace palpate
