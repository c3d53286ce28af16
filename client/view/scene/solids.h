// Round bodies as triangles: spheres, and bodies turned about an axis.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include <span>

#include "client/view/scene/overlay.h"

namespace palpate::view {

struct Paint {
  std::array<std::uint8_t, 4> rgba = {255, 255, 255, 255};
  std::uint8_t alpha_behind = 0;
};

// For one that is small on the screen: it has corners.
void AddSphere(const Vec3& center_D, double radius_mm, const Paint& paint,
               std::vector<SolidVertex>& solids);

// A ring of a turned body; its paint is that of the part up to the next ring.
struct Ring {
  double along_mm = 0.0;
  double radius_mm = 0.0;
  Paint paint{};
};

// `axis` of length 1; rings by rising `along_mm`, counted from the origin. Open where
// the first or the last radius is not 0.
void AddTurned(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
               std::vector<SolidVertex>& solids);

}  // namespace palpate::view
