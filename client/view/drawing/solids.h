// Bodies made of triangles: spheres, bodies with flat faces, and bodies turned about an axis; and
// the polygons from which round ones are made.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include <span>
#include <vector>

#include "client/view/drawing/overlay.h"

namespace palpate::view {

struct Paint {
  Rgba8 rgba = {255, 255, 255, 255};
  std::uint8_t alpha_behind = 0;
};

// A regular polygon. `x` and `y` have length 1 and are at right angles; the first corner is at
// `first_rad` from x towards y.
std::vector<Vec3> Polygon(const Vec3& center_D, double radius_mm, int corners, const Vec3& x,
                          const Vec3& y, double first_rad = 0.0);
// A regular polygon across an axis of length 1.
std::vector<Vec3> PolygonAbout(const Vec3& axis, const Vec3& center_D, double radius_mm,
                               int corners);

// For a sphere that is small on the screen: its corners are visible on a large one.
void AddSphere(const Vec3& center_D, double radius_mm, const Paint& paint,
               std::vector<SolidVertex>& solids);

// `R_DB` turns the axes of the body into D. The cube's edges and the octahedron's corners are along
// the axes.
void AddCube(const Vec3& center_D, double half_edge_mm, const Mat3& R_DB, const Paint& paint,
             std::vector<SolidVertex>& solids);
void AddOctahedron(const Vec3& center_D, double radius_mm, const Mat3& R_DB, const Paint& paint,
                   std::vector<SolidVertex>& solids);

// A ring of a turned body. Its paint covers the part up to the next ring.
struct Ring {
  double along_mm = 0.0;
  double radius_mm = 0.0;
  Paint paint{};
};

// `axis` has length 1. Rings are sorted by rising `along_mm`, counted from the origin. The body is
// open if the first or last radius is not 0.
void AddTurned(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
               std::vector<SolidVertex>& solids);

}  // namespace palpate::view
