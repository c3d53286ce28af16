#include "server/haptics/moves.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

constexpr int kCorrectionTries = 12;
// A density within τ by less than this, of the greatest of the simplex, is τ but for rounding.
constexpr double kDensityRounding = 1e-15;
// Moving weight onto H leaves each vertex more than this, so that Normalize drops none.
constexpr double kLeastWeight = 1e-11;
// A direction within this share of a face's plane counts as along the face.
constexpr double kAlongFaceTolerance = 1e-12;

// Moves weight from the densest vertex to the least dense one until the density is at most τ. If
// `on_surface`, moves weight back at first where Normalize took the point off H. The simplex stays
// the same or loses a vertex. Returns false if the density stays above τ. For a lower bound, all
// densities change their sign.
template <Contact kSide>
bool CorrectDensity(const HapticCell& cell, double bound, bool on_surface, Carrier& carrier) {
  constexpr double sign = kSide == Contact::kLower ? -1.0 : 1.0;
  const double isovalue = sign * bound;
  const auto density = [&](int n) { return sign * cell.parts.density[carrier.vertex[n]]; };
  double excess = sign * DensityAt(cell, carrier) - isovalue;
  // The usual case: τ but for rounding.
  if (!(excess > 0.0) && excess >= -kDensityRounding * std::abs(density(0))) return true;
  for (int tries = 0; tries < kCorrectionTries; ++tries) {
    if (!(excess > 0.0) && (!on_surface || tries > 0)) return true;
    int lo = 0, hi = 0;
    for (int n = 1; n < carrier.count; ++n) {
      if (density(n) < density(lo)) lo = n;
      if (density(n) > density(hi)) hi = n;
    }
    if (lo == hi) return !(excess > 0.0);  // all are equally dense
    double &less = carrier.weight[hi], &more = carrier.weight[lo];
    double shift = excess * (1 << tries) / (density(hi) - density(lo));
    const double rounding =
        kDensityRounding * std::max(std::abs(density(lo)), std::abs(density(hi)));
    if (!(excess > 0.0) && !(excess < -rounding && more + shift > kLeastWeight)) return true;
    // At least the last bit: a smaller shift would change nothing.
    if (excess > 0.0) shift = std::max(shift, less - std::nextafter(less, 0.0));
    shift = std::clamp(shift, -more, less);
    less -= shift;
    more += shift;
    carrier.Normalize();
    excess = sign * DensityAt(cell, carrier) - isovalue;
  }
  return !(excess > 0.0);
}

// Keeps the density within its bounds, and on that of `contact`. Returns the bound at which it
// could not; kNone: it could.
Contact KeepWithin(const HapticSurface& surface, const HapticCell& cell, Contact contact,
                   Carrier& carrier) {
  using enum Contact;
  if (surface.isovalue != kUnbounded &&
      !CorrectDensity<kUpper>(cell, surface.isovalue, contact == kUpper, carrier)) {
    return kUpper;
  }
  if (surface.lower != -kUnbounded &&
      !CorrectDensity<kLower>(cell, surface.lower, contact == kLower, carrier)) {
    return kLower;
  }
  return kNone;
}

// Barycentric weights of a point in a tetrahedron, and their rates along a move.
struct Course {
  std::array<double, 4> weight, rate;
};

Course CourseOf(const Candidate& candidate, const std::array<std::uint8_t, 4>& vertices,
                const WeightGradients& gradients) {
  Course course;
  const Carrier& carrier = candidate.carrier;
  std::array<double, kMaxVertices> weight_at;  // only of the tetrahedron's vertices
  for (const int v : vertices) weight_at[v] = 0.0;
  carrier.Visit([&](int c) { weight_at[carrier.vertex[c]] = carrier.weight[c]; });
  for (int n = 0; n < 4; ++n) {
    course.weight[n] = weight_at[vertices[n]];
    course.rate[n] = gradients[n].normal.dot(candidate.d_mm);
  }
  if (carrier.count == 4) return course;
  // Along a face the rate is 0 except for rounding. Rounding must not make the point leave the
  // face.
  const double along2 = kAlongFaceTolerance * kAlongFaceTolerance * candidate.d_mm.squaredNorm();
  for (int n = 0; n < 4; ++n) {
    if (course.weight[n] != 0.0) continue;
    const double rate = course.rate[n];
    if (rate < 0.0 || rate * rate < along2 * gradients[n].normal2) course.rate[n] = 0.0;
  }
  return course;
}

// The bound that a move meets, and after which share of the move.
struct Meeting {
  Contact bound = Contact::kNone;
  double share = std::numeric_limits<double>::infinity();
};

Meeting MeetingOf(const HapticSurface& surface, const HapticCell& cell, const Candidate& candidate,
                  const TetrahedronGradients& gradients, Contact out_to) {
  if (candidate.along_surface) return {};
  const double slope = -gradients.fall.normal.dot(candidate.d_mm);
  // Within free space, the density rises to the upper bound; from beyond that, it falls to it.
  const bool is_within = out_to == Contact::kNone;
  const bool is_upper = is_within ? slope > 0.0 : out_to == Contact::kUpper;
  const double bound = is_upper ? surface.isovalue : surface.lower;
  if (is_upper == is_within ? !(slope > 0.0) : !(slope < 0.0)) return {};
  if (std::isinf(bound)) return {};
  return {is_upper ? Contact::kUpper : Contact::kLower,
          std::max(0.0, (bound - DensityAt(cell, candidate.carrier)) / slope)};
}

}  // namespace

MoveEnd MoveInTetrahedron(const HapticSurface& surface, const Candidate& candidate, Contact out_to,
                          Place& place, Contact& contact, CellCache& cache) noexcept {
  HapticCell& cell = *candidate.entry;
  const auto& vertices = cell.parts.complex.vertices[candidate.tetrahedron];
  const TetrahedronGradients gradients = cache.Gradients(cell, candidate.tetrahedron);
  const Course course = CourseOf(candidate, vertices, gradients.weight);
  double end = 1.0;
  int hit = -1;
  for (int n = 0; n < 4; ++n) {
    if (course.rate[n] < 0.0 && course.weight[n] + end * course.rate[n] < 0.0) {
      end = -course.weight[n] / course.rate[n];
      hit = n;
    }
  }
  const Meeting meeting = MeetingOf(surface, cell, candidate, gradients, out_to);
  const bool reached = meeting.share < end;
  if (reached) end = meeting.share, hit = -1;
  Carrier moved;
  moved.count = 4;
  moved.vertex = vertices;
  for (int n = 0; n < 4; ++n) moved.weight[n] = course.weight[n] + end * course.rate[n];
  if (hit >= 0) moved.weight[hit] = 0.0;
  moved.Normalize();
  const Contact on = reached ? meeting.bound : candidate.along_surface ? contact : Contact::kNone;
  const bool is_out = out_to == Contact::kNone || on != Contact::kNone;
  const Contact beyond = is_out ? KeepWithin(surface, cell, on, moved) : Contact::kNone;
  if (beyond != Contact::kNone) {
    // H comes first, but rounding put a face before it. The point stays, and the next move takes H
    // into account.
    const bool new_constraint = contact == Contact::kNone;
    SetSimplex(cell, candidate.carrier, candidate.tetrahedron, place);
    contact = beyond;
    return new_constraint ? MoveEnd::kMore : MoveEnd::kNone;
  }
  SetSimplex(cell, moved, candidate.tetrahedron, place);
  contact = on;
  // Inside the tetrahedron, the part of the move that was cut off is across H.
  const bool whole = hit < 0 && !reached && place.tetrahedron >= 0;
  return whole ? MoveEnd::kAtRest : MoveEnd::kMore;
}

bool CrossBound(const HapticSurface& surface, Contact bound, Place& place,
                CellCache& cache) noexcept {
  const HapticCell& cell = cache.Decomposed(surface, place.cell);
  Carrier carrier = place.carrier;
  const bool crosses = bound == Contact::kUpper
                           ? CorrectDensity<Contact::kLower>(cell, surface.isovalue, true, carrier)
                           : CorrectDensity<Contact::kUpper>(cell, surface.lower, true, carrier);
  if (!crosses) return false;
  SetSimplex(cell, carrier, place.tetrahedron, place);
  return true;
}

void MoveInBox(const HapticSurface& surface, const Candidate& candidate, Place& place,
               CellCache& cache) noexcept {
  const Vec3 d = surface.X_LD.linear * candidate.d_mm;
  const Vec3 from = PlaceLatticePosition(surface, place, cache);
  Vec3i first = candidate.cell;
  int edge = 1;
  if (candidate.entry->max_of_voxels <= surface.isovalue &&
      candidate.entry->min_of_voxels >= surface.lower) {
    edge = surface.lattice.refinement();
    if (edge > 1) first -= surface.lattice.PartOf(candidate.cell).sub;
  }
  const Vec3 lo = first.cast<double>(), hi = lo + Vec3::Constant(edge);
  const auto stays = [&](int axis) {
    const int on = candidate.faces >> (2 * axis) & 3;
    return (on == 1 && d[axis] <= 0.0) || (on == 2 && d[axis] >= 0.0) || d[axis] == 0.0;
  };
  double end = 1.0;
  int hit = -1;
  for (int axis = 0; axis < 3; ++axis) {
    if (stays(axis)) continue;
    const double t = ((d[axis] > 0.0 ? hi : lo)[axis] - from[axis]) / d[axis];
    if (t < end) {
      end = t;
      hit = axis;
    }
  }
  Vec3 to = from;
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == hit) {
      to[axis] = d[axis] > 0.0 ? hi[axis] : lo[axis];
    } else if (!stays(axis)) {
      to[axis] = std::clamp(from[axis] + end * d[axis], lo[axis], hi[axis]);
    }
  }
  const Vec3 last = hi - Vec3::Ones();
  SetBox(to.array().floor().matrix().cwiseMin(last).cast<int>(), to, place);
}

void MoveOut(const HapticSurface& surface, const Candidate& candidate, const Vec3& target_L,
             Place& place) noexcept {
  place.kind = Place::Kind::kOutside;
  place.faces = 0;
  place.p_L = target_L;
  // Rounding must not leave the point inside the lattice.
  for (int axis = 0; axis < 3; ++axis) {
    const int size = surface.lattice.size()[axis];
    if (candidate.cell[axis] < -1) place.p_L[axis] = std::min(place.p_L[axis], -1.0);
    if (candidate.cell[axis] >= size) place.p_L[axis] = std::max<double>(place.p_L[axis], size);
  }
}

void MoveOutside(const HapticSurface& surface, const Vec3& target_L, Place& place) noexcept {
  const Vec3 lo = Vec3::Constant(-1.0), hi = surface.lattice.size().cast<double>();
  const Vec3 from = place.p_L, d = target_L - from;
  double enter = 0.0, leave = 1.0;
  int axis_in = -1;
  for (int axis = 0; axis < 3; ++axis) {
    if (d[axis] == 0.0) {
      if (from[axis] <= lo[axis] || from[axis] >= hi[axis]) enter = 2.0;
      continue;
    }
    const double a = (lo[axis] - from[axis]) / d[axis], b = (hi[axis] - from[axis]) / d[axis];
    if (std::min(a, b) >= enter) {
      enter = std::min(a, b);
      axis_in = axis;
    }
    leave = std::min(leave, std::max(a, b));
  }
  if (axis_in < 0 || !(enter < leave)) {
    place.kind = Place::Kind::kOutside;
    place.p_L = target_L;
    place.faces = 0;
    return;
  }
  Vec3 p = (from + enter * d).cwiseMax(lo).cwiseMin(hi);
  p[axis_in] = d[axis_in] > 0.0 ? lo[axis_in] : hi[axis_in];
  const Vec3 cell = p.array().floor().matrix().cwiseMin(hi - Vec3::Ones());
  SetBox(cell.cast<int>(), p, place);
}

}  // namespace palpate
