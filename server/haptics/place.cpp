#include "server/haptics/place.h"

#include <algorithm>
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

Carrier FromWeights(const std::uint8_t* vertices, const double* weights, int count) {
  Carrier carrier;
  carrier.count = count;
  for (int n = 0; n < count; ++n) {
    carrier.vertex[n] = vertices[n];
    carrier.weight[n] = std::max(0.0, weights[n]);
  }
  carrier.Normalize();
  return carrier;
}

Carrier LocateOnEdge(const Vec3& local, std::uint8_t faces) {
  int o[3] = {0, 0, 0};
  int free_axis = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int on = faces >> (2 * axis) & 3;
    if (on) o[axis] = on >> 1;
    if (!on) free_axis = axis;
  }
  std::uint8_t vertex[2];
  double weight[2] = {1.0 - local[free_axis], local[free_axis]};
  for (int side = 0; side < 2; ++side) {
    o[free_axis] = side;
    vertex[side] = static_cast<std::uint8_t>(CornerAt(o[0], o[1], o[2]));
  }
  return FromWeights(vertex, weight, 2);
}

// The triangles of a face: around the face's vertex, or (kTptd, without a saddle) on both sides of
// a diagonal.
int FaceTriangles(const HapticCell& cell, int face,
                  std::array<std::array<std::uint8_t, 3>, 4>& triangles) {
  std::array<std::uint8_t, 4> k;
  for (int n = 0; n < 4; ++n) k[n] = static_cast<std::uint8_t>(kFaceCorners[face][n]);
  const auto centre = static_cast<std::uint8_t>(kFirstFaceVertex + face);
  if (cell.parts.complex.used_vertices >> centre & 1) {
    for (int n = 0; n < 4; ++n) triangles[n] = {centre, k[n], k[(n + 1) % 4]};
    return 4;
  }
  triangles[0] = {k[0], k[1], k[2]};
  triangles[1] = {k[0], k[2], k[3]};
  return 2;
}

Carrier LocateOnFace(const HapticCell& cell, const Vec3& local, int face) {
  const int axis = face / 2, b = axis == 0 ? 1 : 0, c = axis == 2 ? 1 : 2;
  const auto flat = [&](const Vec3& p) { return Eigen::Vector2d(p[b], p[c]); };
  std::array<std::array<std::uint8_t, 3>, 4> triangles{};
  const int count = FaceTriangles(cell, face, triangles);
  double best = -std::numeric_limits<double>::infinity();
  int found = 0;
  std::array<double, 3> weight{};
  for (int n = 0; n < count; ++n) {
    const Eigen::Vector2d o = flat(cell.parts.position[triangles[n][0]]);
    const Eigen::Vector2d e0 = flat(cell.parts.position[triangles[n][1]]) - o;
    const Eigen::Vector2d e1 = flat(cell.parts.position[triangles[n][2]]) - o;
    const Eigen::Vector2d q = flat(local) - o;
    const double det = e0.x() * e1.y() - e0.y() * e1.x();
    const double u = (q.x() * e1.y() - q.y() * e1.x()) / det;
    const double v = (e0.x() * q.y() - e0.y() * q.x()) / det;
    const double least = std::min({u, v, 1.0 - u - v});
    if (least <= best) continue;
    best = least;
    found = n;
    weight = {1.0 - u - v, u, v};
  }
  return FromWeights(triangles[found].data(), weight.data(), 3);
}

Carrier LocateInside(const HapticCell& cell, const Vec3& local) {
  const TetrahedralComplex& complex = cell.parts.complex;
  double best = -std::numeric_limits<double>::infinity();
  std::array<double, 4> weight{};
  int found = 0;
  for (int t = 0; t < complex.tetrahedron_count; ++t) {
    std::array<Vec3, 4> corner;
    for (int n = 0; n < 4; ++n) corner[n] = cell.parts.position[complex.vertices[t][n]];
    const std::array<double, 4> candidate = Barycentric(corner, local);
    const double least = *std::min_element(candidate.begin(), candidate.end());
    if (least <= best) continue;
    best = least;
    weight = candidate;
    found = t;
  }
  return FromWeights(complex.vertices[found].data(), weight.data(), 4);
}

}  // namespace

void Carrier::Normalize() {
  int kept = 0;
  double sum = 0.0;
  for (int n = 0; n < count; ++n) {
    if (!(weight[n] > 0.0)) continue;
    vertex[kept] = vertex[n];
    weight[kept] = weight[n];
    sum += weight[n];
    ++kept;
  }
  count = kept;
  const double inverse = 1.0 / sum;
  for (int n = 0; n < count; ++n) weight[n] *= inverse;
}

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
  for (int n = 0; n < carrier.count; ++n) {
    const int v = carrier.vertex[n];
    if (v < kFirstFaceVertex) {
      const auto& o = kCornerOffset[v];
      mapped.vertex[n] = static_cast<std::uint8_t>(
          CornerAt(o[0] - offset.x(), o[1] - offset.y(), o[2] - offset.z()));
    } else if (v < kFirstInteriorVertex && !offset.isZero()) {
      mapped.vertex[n] = static_cast<std::uint8_t>(kFirstFaceVertex + ((v - kFirstFaceVertex) ^ 1));
    }
  }
  return mapped;
}

Carrier Locate(const HapticCell& cell, const Vec3& local, std::uint8_t faces) {
  int axes = 0, face = 0, corner[3] = {0, 0, 0};
  for (int axis = 0; axis < 3; ++axis) {
    const int on = faces >> (2 * axis) & 3;
    if (!on) continue;
    ++axes;
    corner[axis] = on >> 1;
    face = 2 * axis + (on >> 1);
  }
  if (axes == 0) return LocateInside(cell, local);
  if (axes == 1) return LocateOnFace(cell, local, face);
  if (axes == 2) return LocateOnEdge(local, faces);
  Carrier carrier;
  carrier.count = 1;
  carrier.vertex[0] = static_cast<std::uint8_t>(CornerAt(corner[0], corner[1], corner[2]));
  carrier.weight[0] = 1.0;
  return carrier;
}

double DensityAt(const HapticCell& cell, const Carrier& carrier) {
  double density = 0.0;
  for (int n = 0; n < carrier.count; ++n) {
    density += carrier.weight[n] * cell.parts.density[carrier.vertex[n]];
  }
  return density;
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

std::uint8_t FacesOf(const Carrier& carrier) {
  std::uint8_t faces = carrier.count > 0 ? 0x3f : 0;
  for (int n = 0; n < carrier.count; ++n) faces &= kVertexFaces[carrier.vertex[n]];
  return faces;
}

void SetSimplex(const HapticCell& cell, const Carrier& carrier, int tetrahedron, Place& place) {
  place.kind = Place::Kind::kSimplex;
  place.cell = cell.cell;
  place.carrier = carrier;
  place.faces = FacesOf(carrier);
  place.tetrahedron = carrier.count == 4 ? tetrahedron : -1;
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
  SetSimplex(cell, Locate(cell, p_I - place.cell.cast<double>(), place.faces), -1, place);
  density = DensityAt(cell, place.carrier);
  return place;
}

double PlaceDensity(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind == Place::Kind::kOutside) return surface.DensityOutside();
  if (place.kind == Place::Kind::kSimplex) {
    return DensityAt(cache.Decomposed(surface, place.cell), place.carrier);
  }
  const HapticCell& cell = cache.Densities(surface, place.cell);
  // Rounding of the interpolation must not give more than the densest corner.
  return std::min(Trilinear(cell.densities).Value(place.p_I - place.cell.cast<double>()),
                  cell.max_density);
}

Vec3 PlacePosition(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept {
  if (place.kind != Place::Kind::kSimplex) return surface.X_DI.Apply(place.p_I);
  // Uses the cell's own vertices: this keeps more digits than the index.
  const HapticCell& cell = cache.Decomposed(surface, place.cell);
  Vec3 p = Vec3::Zero();
  for (int n = 0; n < place.carrier.count; ++n) {
    p += place.carrier.weight[n] * cell.vertex_mm[place.carrier.vertex[n]];
  }
  return cell.origin_mm + p;
}

Vec3 PlaceIndexPosition(const HapticSurface& surface, const Place& place,
                        CellCache& cache) noexcept {
  if (place.kind != Place::Kind::kSimplex) return place.p_I;
  return place.cell.cast<double>() +
         LocalPosition(cache.Decomposed(surface, place.cell), place.carrier);
}

}  // namespace palpate
