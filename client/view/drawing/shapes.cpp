#include "client/view/drawing/shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

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

namespace {

constexpr Rgba8 kDark = {24, 28, 36, 0};
constexpr Rgba8 kLight = {236, 240, 246, 0};
constexpr double kMostDashes = 400.0;
constexpr Rgba8 kLetterColor = {235, 238, 245, 255};

// Corners of strokes, as digits x and y, on a grid of 4 by 6 from the lower left corner.
constexpr std::pair<char, std::string_view> kStrokes[] = {
    {'L', "06 00 40"},
    {'R', "00 06 36 45 44 33 03/23 40"},
    {'A', "00 26 40/12 32"},
    {'P', "00 06 36 45 44 33 03"},
    {'S', "45 36 16 05 04 13 33 42 41 30 10 01"},
    {'I', "20 26/10 30/16 36"}};

int DashesIn(double length_mm, double dash_mm) {
  return static_cast<int>(std::ceil(std::clamp(length_mm / dash_mm, 1.0, kMostDashes)));
}

double RadiusAt(double along_mm, const Ring& low, const Ring& high) {
  const double span_mm = high.along_mm - low.along_mm;
  const double share = span_mm > 0.0 ? (along_mm - low.along_mm) / span_mm : 0.0;
  return low.radius_mm + std::clamp(share, 0.0, 1.0) * (high.radius_mm - low.radius_mm);
}

void AddLetter(std::string_view strokes, const Vec3& center_D, const Vec3& right_D,
               const Vec3& up_D, Overlay& overlay) {
  const auto corner = [&](std::size_t at) -> Vec3 {
    const double x = (strokes[at] - '0' - 2) / 6.0;
    const double y = (strokes[at + 1] - '0' - 3) / 6.0;
    return center_D + x * right_D + y * up_D;
  };
  for (std::size_t at = 3; at < strokes.size(); at += 3) {
    if (strokes[at - 1] != '/') AddLine(corner(at - 3), corner(at), kLetterColor, 0, overlay);
  }
}

}  // namespace

void AddLine(const Vec3& from_D, const Vec3& to_D, const Rgba8& rgba, std::uint8_t alpha_behind,
             Overlay& overlay) {
  overlay.lines.push_back({from_D.cast<float>(), rgba, alpha_behind});
  overlay.lines.push_back({to_D.cast<float>(), rgba, alpha_behind});
}

void AddOutline(std::span<const Vec3> corners_D, const Rgba8& rgba, std::uint8_t alpha_behind,
                Overlay& overlay) {
  for (std::size_t n = 0; n < corners_D.size(); ++n) {
    AddLine(corners_D[n], corners_D[(n + 1) % corners_D.size()], rgba, alpha_behind, overlay);
  }
}

void AddBox(const AffineMap& X_DI, const Vec3& min_I, const Vec3& max_I, const Rgba8& rgba,
            std::uint8_t alpha_behind, Overlay& overlay) {
  for (int axis = 0; axis < 3; ++axis) {
    for (int corner = 0; corner < 4; ++corner) {
      Vec3 from_I = min_I;
      if (corner & 1) from_I[(axis + 1) % 3] = max_I[(axis + 1) % 3];
      if (corner & 2) from_I[(axis + 2) % 3] = max_I[(axis + 2) % 3];
      Vec3 to_I = from_I;
      to_I[axis] = max_I[axis];
      AddLine(X_DI.Apply(from_I), X_DI.Apply(to_I), rgba, alpha_behind, overlay);
    }
  }
}

void AddGhostOutline(std::span<const Vec3> corners_D, Rgba8 rgba, Overlay& overlay) {
  rgba[3] = 0;
  AddOutline(corners_D, rgba, kGhostLine, overlay);
}

void AddGhostDashes(const Vec3& from_D, const Vec3& to_D, double dash_mm, Rgba8 rgba,
                    Overlay& overlay) {
  rgba[3] = 0;
  const Vec3 way = to_D - from_D;
  const int steps = DashesIn(way.norm(), dash_mm);
  for (int n = 0; n < steps; n += 2) {
    AddLine(from_D + way * n / steps, from_D + way * (n + 1) / steps, rgba, kGhostLine, overlay);
  }
}

void AddGhostEdges(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
                   const Vec3& eye_D, double dash_mm, Overlay& overlay) {
  const Vec3 across = axis.cross(eye_D - origin_D);
  if (rings.empty() || across.norm() < 1e-6) return;
  const Vec3 aside = across.normalized();
  const double begin_mm = rings.front().along_mm;
  const double length_mm = rings.back().along_mm - begin_mm;
  const int steps = DashesIn(length_mm, dash_mm);
  std::size_t part = 0;
  const auto edge = [&](int step, double side) -> Vec3 {
    const double along_mm = begin_mm + length_mm * step / steps;
    while (part + 2 < rings.size() && rings[part + 1].along_mm < along_mm) ++part;
    const double radius_mm = RadiusAt(along_mm, rings[part], rings[part + 1]);
    return origin_D + along_mm * axis + side * radius_mm * aside;
  };
  for (const double side : {-1.0, 1.0}) {
    part = 0;
    Vec3 last_D = edge(0, side);
    for (int step = 1; step <= steps; ++step) {
      const Vec3 next_D = edge(step, side);
      AddLine(last_D, next_D, step % 2 == 1 ? kDark : kLight, kGhostLine, overlay);
      last_D = next_D;
    }
  }
}

void AddLetters(std::string_view letters, const Vec3& center_D, const Vec3& right_D,
                const Vec3& up_D, Overlay& overlay) {
  constexpr double kApart = 0.9;  // of the height
  double aside = -0.5 * kApart * static_cast<double>(letters.size() - 1);
  for (const char letter : letters) {
    for (const auto& [name, strokes] : kStrokes) {
      if (name == letter) AddLetter(strokes, center_D + aside * right_D, right_D, up_D, overlay);
    }
    aside += kApart;
  }
}

}  // namespace palpate::view
