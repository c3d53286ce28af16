// Shapes of the overlay: bodies made of triangles, and lines.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include <span>
#include <string_view>
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

// Lines of the overlay: edges, outlines, dashes, letters.
//
// Ghosts mark what the surface hides, as in a technical drawing. Where nothing hides them, they are
// not drawn.

inline constexpr std::uint8_t kGhostLine = 235;  // alpha of outlines and dashes
inline constexpr std::uint8_t kGhostBody = 45;   // alpha of the body within

void AddLine(const Vec3& from_D, const Vec3& to_D, const Rgba8& rgba, std::uint8_t alpha_behind,
             Overlay& overlay);
// Closes the outline from its last corner to its first.
void AddOutline(std::span<const Vec3> corners_D, const Rgba8& rgba, std::uint8_t alpha_behind,
                Overlay& overlay);
// The edges of a box in I.
void AddBox(const AffineMap& X_DI, const Vec3& min_I, const Vec3& max_I, const Rgba8& rgba,
            std::uint8_t alpha_behind, Overlay& overlay);

void AddGhostOutline(std::span<const Vec3> corners_D, Rgba8 rgba, Overlay& overlay);
// A corner on each dash's begin and end. A line of more than 400 dashes gets longer ones.
void AddGhostDashes(const Vec3& from_D, const Vec3& to_D, double dash_mm, Rgba8 rgba,
                    Overlay& overlay);
// The two edges of a turned body (AddTurned) as it is seen from `eye_D`. Dark dashes take turns
// with light ones, so that they are visible on any surface. None if the eye is on the axis.
void AddGhostEdges(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
                   const Vec3& eye_D, double dash_mm, Overlay& overlay);

// The patient's axes, so that every picture of the view has them. `letters`: of LRAPSI. `right_D`
// and `up_D` are as long as a letter is high.
void AddLetters(std::string_view letters, const Vec3& center_D, const Vec3& right_D,
                const Vec3& up_D, Overlay& overlay);

}  // namespace palpate::view
