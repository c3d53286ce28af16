#include "server/haptics/moves.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr int kCorrectionTries = 12;
// A direction within this share of a face's plane runs along the face.
constexpr double kAlongFaceTolerance = 1e-12;

Vec3 CellOrigin(const HapticSurface& surface, const Vec3i& cell) {
  return surface.X_DI.Apply(cell.cast<double>());
}

// Inward normals, in D, of the faces of a cell that hold the point.
Cone BoxCone(const HapticSurface& surface, std::uint8_t faces) {
  Cone cone;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 normal = surface.X_ID.linear.row(axis);
    if (faces >> (2 * axis) & 1) cone.Add(normal);
    if (faces >> (2 * axis + 1) & 1) cone.Add(-normal);
  }
  return cone;
}

// The candidate wins where its direction is longer.
void Keep(const Candidate& candidate, Candidate& best) {
  if (candidate.d_mm.squaredNorm() > best.d_mm.squaredNorm()) best = candidate;
}

// The place as a simplex of the cell at `offset`.
Carrier CarrierIn(const HapticCell& cell, const Place& place, const Vec3i& offset,
                  std::uint8_t faces) {
  if (place.kind == Place::Kind::kSimplex) return CarrierInNeighbour(place.carrier, offset);
  return Locate(cell, place.p_I - cell.cell.cast<double>(), faces);
}

struct TetrahedronCone {
  Cone cone;
  int surface_number = -1;  // of the half-space under H
};

TetrahedronCone MakeTetrahedronCone(const HapticCell& cell, int tetrahedron, std::uint16_t mask,
                                    const TetrahedronGradients& gradients, bool on_surface) {
  TetrahedronCone result;
  const auto& vertices = cell.parts.complex.vertices[tetrahedron];
  for (int n = 0; n < 4; ++n) {
    if (!(mask >> vertices[n] & 1)) result.cone.Add(gradients.weight[n]);
  }
  if (on_surface) result.surface_number = result.cone.Add(-gradients.density);
  return result;
}

// Takes weight from the densest vertex to the least dense one until the density
// is at most τ; the simplex stays the same or loses the vertex. False where it
// cannot.
bool LowerToIsovalue(const HapticCell& cell, double isovalue, Carrier& carrier) {
  const auto density = [&](int n) { return cell.parts.density[carrier.vertex[n]]; };
  double excess = DensityAt(cell, carrier) - isovalue;
  for (int tries = 0; tries < kCorrectionTries && excess > 0.0; ++tries) {
    int lo = 0, hi = 0;
    for (int n = 1; n < carrier.count; ++n) {
      if (density(n) < density(lo)) lo = n;
      if (density(n) > density(hi)) hi = n;
    }
    if (!(density(hi) > density(lo))) return false;
    const double wanted = std::ldexp(excess, tries) / (density(hi) - density(lo));
    // At least the last bit: a smaller shift would change nothing.
    const double less =
        std::min(carrier.weight[hi] - wanted, std::nextafter(carrier.weight[hi], 0.0));
    const double shift = carrier.weight[hi] - std::max(less, 0.0);
    carrier.weight[hi] -= shift;
    carrier.weight[lo] += shift;
    carrier.Normalize();
    excess = DensityAt(cell, carrier) - isovalue;
  }
  return !(excess > 0.0);
}

void SetSimplex(const HapticCell& cell, const Carrier& carrier, Place& place) {
  place.kind = Place::Kind::kSimplex;
  place.cell = cell.cell;
  place.carrier = carrier;
  place.faces = FacesOf(carrier);
  place.p_I = cell.cell.cast<double>() + LocalPosition(cell, carrier);
}

}  // namespace

TetrahedronGradients::TetrahedronGradients(const HapticCell& cell, int tetrahedron) {
  const auto& v = cell.parts.complex.vertices[tetrahedron];
  const Vec3& o = cell.vertex_mm[v[0]];
  const Vec3 a = cell.vertex_mm[v[1]] - o;
  const Vec3 b = cell.vertex_mm[v[2]] - o;
  const Vec3 c = cell.vertex_mm[v[3]] - o;
  const Vec3 bc = b.cross(c);
  const double inverse_det = 1.0 / a.dot(bc);
  weight[1] = bc * inverse_det;
  weight[2] = c.cross(a) * inverse_det;
  weight[3] = a.cross(b) * inverse_det;
  weight[0] = -(weight[1] + weight[2] + weight[3]);
  const auto& d = cell.parts.density;
  density = (d[v[1]] - d[v[0]]) * weight[1] + (d[v[2]] - d[v[0]]) * weight[2] +
            (d[v[3]] - d[v[0]]) * weight[3];
}

Candidate BestDirection(const HapticSurface& surface, const Place& place, bool on_surface,
                        const Vec3& w_mm, CellCache& cache) noexcept {
  Candidate best;
  VisitNeighbours(place.faces, [&](const Vec3i& offset) {
    if (best.full) return;
    Candidate candidate;
    candidate.cell = place.cell + offset;
    candidate.faces = FacesInNeighbour(place.faces, offset);
    if (!surface.volume->HasCell(candidate.cell)) {
      if (!surface.IsFreeOutside()) return;
      // Free, and convex where it counts: a way out is taken whole.
      if (ProjectOnCone(w_mm, BoxCone(surface, candidate.faces)).active == 0) {
        candidate.kind = Candidate::Kind::kOutside;
        candidate.d_mm = w_mm;
        candidate.full = true;
        best = candidate;
      }
      return;
    }
    const HapticCell& densities = cache.Densities(surface, candidate.cell);
    if (densities.IsFree(surface.isovalue)) {
      const ConeProjection projection = ProjectOnCone(w_mm, BoxCone(surface, candidate.faces));
      candidate.kind = Candidate::Kind::kBox;
      candidate.d_mm = projection.d;
      candidate.full = projection.active == 0;
      Keep(candidate, best);
      return;
    }
    if (!densities.IsCrossed(surface.isovalue)) return;  // solid
    const HapticCell& cell = cache.Decomposed(surface, candidate.cell);
    candidate.kind = Candidate::Kind::kTetrahedron;
    candidate.carrier = CarrierIn(cell, place, offset, candidate.faces);
    const std::uint16_t mask = candidate.carrier.Mask();
    const TetrahedralComplex& complex = cell.parts.complex;
    for (int t = 0; t < complex.tetrahedron_count && !best.full; ++t) {
      if ((complex.vertex_mask[t] & mask) != mask) continue;
      const TetrahedronGradients gradients(cell, t);
      const TetrahedronCone tangent = MakeTetrahedronCone(cell, t, mask, gradients, on_surface);
      const ConeProjection projection = ProjectOnCone(w_mm, tangent.cone);
      candidate.tetrahedron = t;
      candidate.d_mm = projection.d;
      candidate.full = projection.active == 0;
      candidate.along_surface =
          tangent.surface_number >= 0 && (projection.active >> tangent.surface_number & 1);
      Keep(candidate, best);
    }
  });
  return best;
}

Candidate SteepestDescent(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept {
  Candidate best;
  double best_slope = 0.0;
  VisitNeighbours(place.faces, [&](const Vec3i& offset) {
    Candidate candidate;
    candidate.cell = place.cell + offset;
    if (!surface.volume->HasCell(candidate.cell)) return;
    candidate.faces = FacesInNeighbour(place.faces, offset);
    const HapticCell& cell = cache.Decomposed(surface, candidate.cell);
    candidate.kind = Candidate::Kind::kTetrahedron;
    candidate.carrier = CarrierIn(cell, place, offset, candidate.faces);
    const std::uint16_t mask = candidate.carrier.Mask();
    const TetrahedralComplex& complex = cell.parts.complex;
    for (int t = 0; t < complex.tetrahedron_count; ++t) {
      if ((complex.vertex_mask[t] & mask) != mask) continue;
      const TetrahedronGradients gradients(cell, t);
      const TetrahedronCone tangent = MakeTetrahedronCone(cell, t, mask, gradients, false);
      const Vec3 d = ProjectOnCone(-gradients.density, tangent.cone).d;
      // d is orthogonal to what the cone cuts off: the slope along it is |d|.
      const double slope = d.norm();
      if (!(slope > best_slope * (1.0 + 1e-12))) continue;
      best_slope = slope;
      best = candidate;
      best.tetrahedron = t;
      // Long enough to fall by the whole range of densities.
      best.d_mm = d / (slope * slope);
    }
  });
  return best;
}

bool MoveInTetrahedron(const HapticSurface& surface, const Candidate& candidate, bool descending,
                       Place& place, bool& on_surface, CellCache& cache) noexcept {
  const HapticCell& cell = cache.Decomposed(surface, candidate.cell);
  const auto& vertices = cell.parts.complex.vertices[candidate.tetrahedron];
  const TetrahedronGradients gradients(cell, candidate.tetrahedron);
  std::array<double, 4> weight{}, rate{};
  const double along_face = kAlongFaceTolerance * candidate.d_mm.norm();
  double end = 1.0;
  int hit = -1;
  for (int n = 0; n < 4; ++n) {
    for (int c = 0; c < candidate.carrier.count; ++c) {
      if (candidate.carrier.vertex[c] == vertices[n]) weight[n] = candidate.carrier.weight[c];
    }
    rate[n] = gradients.weight[n].dot(candidate.d_mm);
    // Along a face the rate is 0 but for rounding, which must not leave the face.
    if (weight[n] == 0.0 && rate[n] < along_face * gradients.weight[n].norm()) rate[n] = 0.0;
    if (rate[n] < 0.0 && -weight[n] / rate[n] < end) {
      end = -weight[n] / rate[n];
      hit = n;
    }
  }
  const double slope = gradients.density.dot(candidate.d_mm);
  const double to_isovalue = surface.isovalue - DensityAt(cell, candidate.carrier);
  bool reached = false;
  if (!candidate.along_surface && (descending ? slope < 0.0 : slope > 0.0)) {
    const double t = std::max(0.0, to_isovalue / slope);
    if (t < end) {
      end = t;
      hit = -1;
      reached = true;
    }
  }
  Carrier moved;
  moved.count = 4;
  for (int n = 0; n < 4; ++n) {
    moved.vertex[n] = vertices[n];
    moved.weight[n] = n == hit ? 0.0 : weight[n] + end * rate[n];
  }
  moved.Normalize();
  const bool on = reached || candidate.along_surface;
  if ((on || !descending) && !LowerToIsovalue(cell, surface.isovalue, moved)) {
    // Rounding put a face before H although H comes first: stay, and take H
    // into account next time.
    const bool new_constraint = !on_surface;
    SetSimplex(cell, candidate.carrier, place);
    on_surface = true;
    return new_constraint;
  }
  SetSimplex(cell, moved, place);
  on_surface = on;
  return true;
}

void MoveInBox(const HapticSurface& surface, const Candidate& candidate, Place& place) noexcept {
  const Vec3 d = surface.X_ID.linear * candidate.d_mm;
  const Vec3 lo = candidate.cell.cast<double>(), hi = lo + Vec3::Ones();
  double end = 1.0;
  int hit = -1;
  for (int axis = 0; axis < 3; ++axis) {
    const int on = candidate.faces >> (2 * axis) & 3;
    if ((on == 1 && d[axis] <= 0.0) || (on == 2 && d[axis] >= 0.0) || d[axis] == 0.0) continue;
    const double t = ((d[axis] > 0.0 ? hi : lo)[axis] - place.p_I[axis]) / d[axis];
    if (t < end) {
      end = t;
      hit = axis;
    }
  }
  const Vec3 from = place.p_I;
  place.kind = Place::Kind::kBox;
  place.cell = candidate.cell;
  place.faces = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int on = candidate.faces >> (2 * axis) & 3;
    const bool stays = (on == 1 && d[axis] <= 0.0) || (on == 2 && d[axis] >= 0.0);
    double& p = place.p_I[axis];
    if (axis == hit) {
      p = d[axis] > 0.0 ? hi[axis] : lo[axis];
    } else if (!stays) {
      p = std::clamp(from[axis] + end * d[axis], lo[axis], hi[axis]);
    }
    if (p == lo[axis]) place.faces |= static_cast<std::uint8_t>(1u << (2 * axis));
    if (p == hi[axis]) place.faces |= static_cast<std::uint8_t>(2u << (2 * axis));
  }
}

void MoveOut(const HapticSurface& surface, const Candidate& candidate, const Vec3& target_I,
             Place& place) noexcept {
  place.kind = Place::Kind::kOutside;
  place.faces = 0;
  place.p_I = target_I;
  // Rounding must not leave it inside the lattice.
  for (int axis = 0; axis < 3; ++axis) {
    const int size = surface.volume->size()[axis];
    if (candidate.cell[axis] < -1) place.p_I[axis] = std::min(place.p_I[axis], -1.0);
    if (candidate.cell[axis] >= size) place.p_I[axis] = std::max<double>(place.p_I[axis], size);
  }
}

void MoveOutside(const HapticSurface& surface, const Vec3& target_I, Place& place) noexcept {
  const Vec3 lo = Vec3::Constant(-1.0), hi = surface.volume->size().cast<double>();
  const Vec3 from = place.p_I, d = target_I - from;
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
    place.p_I = target_I;
    place.faces = 0;
    return;
  }
  place.kind = Place::Kind::kBox;
  place.faces = 0;
  for (int axis = 0; axis < 3; ++axis) {
    double& p = place.p_I[axis];
    p = std::clamp(from[axis] + enter * d[axis], lo[axis], hi[axis]);
    if (axis == axis_in) p = d[axis] > 0.0 ? lo[axis] : hi[axis];
    const double top = hi[axis] - 1.0;
    place.cell[axis] = static_cast<int>(std::min(std::floor(p), top));
    if (p == place.cell[axis]) place.faces |= static_cast<std::uint8_t>(1u << (2 * axis));
    if (p == place.cell[axis] + 1.0) place.faces |= static_cast<std::uint8_t>(2u << (2 * axis));
  }
}

Place PlaceAt(const HapticSurface& surface, const Vec3& p_I, CellCache& cache,
              double& density) noexcept {
  Place place;
  place.p_I = p_I;
  density = surface.DensityOutside();
  const Vec3 lo = Vec3::Constant(-1.0), hi = surface.volume->size().cast<double>();
  if (!((p_I.array() > lo.array()).all() && (p_I.array() < hi.array()).all())) return place;
  for (int axis = 0; axis < 3; ++axis) {
    place.cell[axis] = static_cast<int>(std::floor(p_I[axis]));
    if (p_I[axis] == place.cell[axis]) place.faces |= static_cast<std::uint8_t>(1u << (2 * axis));
  }
  place.kind = Place::Kind::kBox;
  if (cache.Densities(surface, place.cell).IsFree(surface.isovalue)) {
    density = PlaceDensity(surface, place, cache);
    return place;
  }
  const HapticCell& cell = cache.Decomposed(surface, place.cell);
  SetSimplex(cell, Locate(cell, p_I - place.cell.cast<double>(), place.faces), place);
  density = DensityAt(cell, place.carrier);
  return place;
}

double PlaceDensity(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind == Place::Kind::kOutside) return surface.DensityOutside();
  if (place.kind == Place::Kind::kSimplex) {
    return DensityAt(cache.Decomposed(surface, place.cell), place.carrier);
  }
  const HapticCell& cell = cache.Densities(surface, place.cell);
  // Rounding of the interpolation must not lift it above its corners.
  return std::min(Trilinear(cell.densities).Value(place.p_I - place.cell.cast<double>()),
                  cell.max_density);
}

Vec3 PlacePosition(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind != Place::Kind::kSimplex) return surface.X_DI.Apply(place.p_I);
  // From the cell's own vertices: more digits than by way of p_I.
  const HapticCell& cell = cache.Decomposed(surface, place.cell);
  Vec3 p = Vec3::Zero();
  for (int n = 0; n < place.carrier.count; ++n) {
    p += place.carrier.weight[n] * cell.vertex_mm[place.carrier.vertex[n]];
  }
  return CellOrigin(surface, place.cell) + p;
}

}  // namespace palpate
