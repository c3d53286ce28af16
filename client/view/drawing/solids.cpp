#include "client/view/drawing/solids.h"

#include <cmath>
#include <numbers>

namespace palpate::view {
namespace {

constexpr int kSides = 24;

using Triangle = std::array<Vec3, 3>;

std::vector<Triangle> Octahedron() {
  std::vector<Triangle> triangles;
  for (int octant = 0; octant < 8; ++octant) {
    const Vec3 x = (octant & 1 ? -1.0 : 1.0) * Vec3::UnitX();
    const Vec3 y = (octant & 2 ? -1.0 : 1.0) * Vec3::UnitY();
    const Vec3 z = (octant & 4 ? -1.0 : 1.0) * Vec3::UnitZ();
    const bool mirrored = x.cross(y).dot(z) < 0.0;
    triangles.push_back(mirrored ? Triangle{y, x, z} : Triangle{x, y, z});
  }
  return triangles;
}

// Splits each triangle into four, with their corners on the sphere.
std::vector<Triangle> Divided(const std::vector<Triangle>& triangles) {
  std::vector<Triangle> parts;
  for (const auto& [a, b, c] : triangles) {
    const Vec3 ab = (a + b).normalized(), bc = (b + c).normalized(), ca = (c + a).normalized();
    parts.insert(parts.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
  }
  return parts;
}

SolidVertex Vertex(const Vec3& p_D, const Vec3& normal, const Paint& paint) {
  return {p_D.cast<float>(), normal.cast<float>(), paint.rgba, paint.alpha_behind};
}

// One normal for all corners of a triangle, so that its edges are sharp.
void AddFlat(const Vec3& a_D, const Vec3& b_D, const Vec3& c_D, const Paint& paint,
             std::vector<SolidVertex>& solids) {
  const Vec3 normal = (b_D - a_D).cross(c_D - a_D).normalized();
  for (const Vec3* p_D : {&a_D, &b_D, &c_D}) solids.push_back(Vertex(*p_D, normal, paint));
}

}  // namespace

std::vector<Vec3> Polygon(const Vec3& center_D, double radius_mm, int corners, const Vec3& x,
                          const Vec3& y, double first_rad) {
  std::vector<Vec3> polygon;
  for (int n = 0; n < corners; ++n) {
    const double angle = first_rad + 2.0 * std::numbers::pi * n / corners;
    polygon.push_back(center_D + radius_mm * (std::cos(angle) * x + std::sin(angle) * y));
  }
  return polygon;
}

std::vector<Vec3> PolygonAbout(const Vec3& axis, const Vec3& center_D, double radius_mm,
                               int corners) {
  const Vec3 across = axis.unitOrthogonal();
  return Polygon(center_D, radius_mm, corners, across, axis.cross(across));
}

void AddCube(const Vec3& center_D, double half_edge_mm, const Mat3& R_DB, const Paint& paint,
             std::vector<SolidVertex>& solids) {
  for (int face = 0; face < 6; ++face) {
    const Vec3 out = (face % 2 == 0 ? 1.0 : -1.0) * R_DB.col(face / 2);
    const Vec3 x = R_DB.col((face / 2 + 1) % 3);
    const Vec3 y = out.cross(x);
    const auto corner = [&](double along_x, double along_y) -> Vec3 {
      return center_D + half_edge_mm * (out + along_x * x + along_y * y);
    };
    AddFlat(corner(-1, -1), corner(1, -1), corner(1, 1), paint, solids);
    AddFlat(corner(-1, -1), corner(1, 1), corner(-1, 1), paint, solids);
  }
}

void AddOctahedron(const Vec3& center_D, double radius_mm, const Mat3& R_DB, const Paint& paint,
                   std::vector<SolidVertex>& solids) {
  for (const auto& [a, b, c] : Octahedron()) {
    AddFlat(center_D + radius_mm * (R_DB * a), center_D + radius_mm * (R_DB * b),
            center_D + radius_mm * (R_DB * c), paint, solids);
  }
}

void AddSphere(const Vec3& center_D, double radius_mm, const Paint& paint,
               std::vector<SolidVertex>& solids) {
  static const auto sphere = Divided(Divided(Divided(Octahedron())));
  for (const Triangle& triangle : sphere) {
    for (const Vec3& normal : triangle) {
      solids.push_back(Vertex(center_D + radius_mm * normal, normal, paint));
    }
  }
}

void AddTurned(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
               std::vector<SolidVertex>& solids) {
  const std::vector<Vec3> outwards = PolygonAbout(axis, Vec3::Zero(), 1.0, kSides);
  for (std::size_t n = 0; n + 1 < rings.size(); ++n) {
    const Ring& low = rings[n];
    const Ring& high = rings[n + 1];
    const auto vertex = [&](const Ring& ring, const Vec3& out) {
      const Vec3 normal =
          (high.along_mm - low.along_mm) * out - (high.radius_mm - low.radius_mm) * axis;
      return Vertex(origin_D + ring.along_mm * axis + ring.radius_mm * out, normal.normalized(),
                    low.paint);
    };
    for (std::size_t side = 0; side < kSides; ++side) {
      const Vec3 &here = outwards[side], &next = outwards[(side + 1) % kSides];
      if (low.radius_mm > 0.0) {
        solids.insert(solids.end(), {vertex(low, here), vertex(low, next), vertex(high, next)});
      }
      if (high.radius_mm > 0.0) {
        solids.insert(solids.end(), {vertex(low, here), vertex(high, next), vertex(high, here)});
      }
    }
  }
}

}  // namespace palpate::view
