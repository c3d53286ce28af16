#include "server/haptics/place.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// Barycentric coordinates of p in the tetrahedron with these corners.
std::array<double, 4> Barycentric(const std::array<Vec3, 4>& corner, const Vec3& p) {
  const Vec3 a = corner[1] - corner[0], b = corner[2] - corner[0], c = corner[3] - corner[0];
  const Vec3 q = p - corner[0];
  const double det = a.dot(b.cross(c));
  const double u = q.dot(b.cross(c)) / det;
  const double v = q.dot(c.cross(a)) / det;
  const double w = q.dot(a.cross(b)) / det;
  return {1.0 - u - v - w, u, v, w};
}

// The vertices that lie on all of `faces`.
std::uint16_t VerticesOn(std::uint8_t faces) {
  std::uint16_t vertices = 0;
  for (int v = 0; v < kMaxVertices; ++v) {
    if ((kVertexFaces[v] & faces) == faces) vertices |= static_cast<std::uint16_t>(1u << v);
  }
  return vertices;
}

}  // namespace

std::uint8_t FacesInNeighbour(std::uint8_t faces, const Vec3i& offset) {
  for (int axis = 0; axis < 3; ++axis) {
    if (offset[axis] == 0) continue;
    const auto both = static_cast<std::uint8_t>(3u << (2 * axis));
    const auto touching = static_cast<std::uint8_t>((offset[axis] > 0 ? 1u : 2u) << (2 * axis));
    faces = static_cast<std::uint8_t>((faces & ~both) | touching);
  }
  return faces;
}

Carrier CarrierInNeighbour(const Carrier& carrier, const Vec3i& offset) {
  Carrier mapped = carrier;
  if (offset.isZero()) return mapped;
  for (int n = 0; n < carrier.count; ++n) {
    const int v = carrier.vertex[n];
    if (v < kFirstFaceVertex) {
      const auto& o = kCornerOffset[v];
      mapped.vertex[n] = static_cast<std::uint8_t>(
          CornerAt(o[0] - offset.x(), o[1] - offset.y(), o[2] - offset.z()));
    } else if (v < kFirstInteriorVertex) {
      mapped.vertex[n] = static_cast<std::uint8_t>(kFirstFaceVertex + ((v - kFirstFaceVertex) ^ 1));
    }
  }
  return mapped;
}

Carrier Locate(const HapticCell& cell, const Vec3& local, std::uint8_t faces) {
  const TetrahedralComplex& complex = cell.parts.complex;
  const std::uint16_t candidates = VerticesOn(faces);
  const int needed = 4 - std::popcount(faces);  // of a triangle on a face, of an edge, ...
  double best = -std::numeric_limits<double>::infinity();
  std::array<double, 4> weight{};
  int found = 0;
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    if (std::popcount<std::uint16_t>(complex.vertex_mask[t] & candidates) < needed) continue;
    std::array<Vec3, 4> corner;
    for (int n = 0; n < 4; ++n) corner[n] = cell.parts.position[complex.vertices[t][n]];
    const std::array<double, 4> candidate = Barycentric(corner, local);
    const double least = *std::min_element(candidate.begin(), candidate.end());
    if (!(least > best)) continue;  // also where a flat tetrahedron gives no number
    best = least;
    weight = candidate;
    found = t;
  }
  Carrier carrier;
  for (int n = 0; n < 4; ++n) {
    const std::uint8_t v = complex.vertices[found][n];
    if (!(candidates >> v & 1)) continue;
    carrier.vertex[carrier.count] = v;
    carrier.weight[carrier.count++] = weight[n];
  }
  carrier.Normalize();
  return carrier;
}

Vec3 LocalPosition(const HapticCell& cell, const Carrier& carrier) {
  Vec3 p = Vec3::Zero();
  for (int n = 0; n < carrier.count; ++n) {
    p += carrier.weight[n] * cell.parts.position[carrier.vertex[n]];
  }
  const std::uint8_t faces = FacesOf(carrier);
  for (int axis = 0; axis < 3; ++axis) {
    const int on = faces >> (2 * axis) & 3;
    if (on) p[axis] = on >> 1;
  }
  return p;
}

void SetBox(const Vec3i& cell, const Vec3& p_L, Place& place) {
  place.kind = Place::Kind::kBox;
  place.cell = cell;
  place.p_L = p_L;
  place.faces = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      const double face = cell[axis] + side;
      if (std::abs(p_L[axis] - face) > kPlaceRounding) continue;
      place.p_L[axis] = face;
      place.faces |= static_cast<std::uint8_t>(1u << (2 * axis + side));
    }
  }
}

Place PlaceAt(const HapticSurface& surface, const Vec3& p_L, CellCache& cache,
              double& density) noexcept {
  Place place;
  place.p_L = p_L;
  density = surface.DensityOutside();
  const Vec3 lo = Vec3::Constant(-1.0), hi = surface.lattice.size().cast<double>();
  if (!((p_L.array() > lo.array()).all() && (p_L.array() < hi.array()).all())) return place;
  SetBox(p_L.array().floor().matrix().cast<int>(), p_L, place);
  if (cache.Densities(surface, place.cell).IsFree(surface)) {
    density = PlaceDensity(surface, place, cache);
    return place;
  }
  const HapticCell& cell = cache.Decomposed(surface, place.cell);
  SetSimplex(cell, Locate(cell, place.p_L - place.cell.cast<double>(), place.faces), -1, place);
  density = DensityAt(cell, place.carrier);
  return place;
}

double PlaceDensity(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind == Place::Kind::kOutside) return surface.DensityOutside();
  if (place.kind == Place::Kind::kSimplex) {
    return DensityAt(cache.Decomposed(surface, place.cell), place.carrier);
  }
  const HapticCell& cell = cache.Densities(surface, place.cell);
  // Rounding of the interpolation must not take it out of a free cell.
  double density = Trilinear(cell.densities).Value(place.p_L - place.cell.cast<double>());
  if (surface.isovalue != kUnbounded) density = std::min(density, cell.max_density);
  if (surface.lower != -kUnbounded) density = std::max(density, cell.min_density);
  return density;
}

Vec3 PlacePosition(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind != Place::Kind::kSimplex) return surface.X_DL.Apply(place.p_L);
  return PositionIn(cache.Decomposed(surface, place.cell), place.carrier);
}

Vec3 PlaceLatticePosition(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept {
  if (place.kind != Place::Kind::kSimplex) return place.p_L;
  return place.cell.cast<double>() +
         LocalPosition(cache.Decomposed(surface, place.cell), place.carrier);
}

}  // namespace palpate
