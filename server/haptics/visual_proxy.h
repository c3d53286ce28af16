// The visual proxy SCP_V: the contact point that viewers draw. Viewers show the trilinear
// isosurface V, while the stylus feels H.
//
// SCP_V is the nearest point where the line through SCP_H along n_E meets V. n_E is interpolated
// from the normals of V's density at the corners of the piece of H that holds SCP_H. The density
// along the line is a cubic in every cell. The line is followed both ways across cells. In a
// crease, the line along n_E can miss V; the normals of V's density at SCP_H, the contact normal
// and, on a refined lattice, the ways to the vertices around SCP_H are then tried.
//
// V comes from the stored densities, H from the resolved ones (cell.h). If τ is the least value of
// the volume, V does not exist although H does.
//
// Frame: D (mm). Threads: pure. Real-time: no allocation, bounded.
// Source: Corenthy et al., section 4.3. Never used for the force.
#pragma once

#include "server/haptics/haptic_surface.h"
#include "server/haptics/place.h"

namespace palpate {

// The length of the line from SCP_H each way, in longest voxel edges.
inline constexpr double kVisualReachVoxels = 4.0;

struct VisualProxy {
  bool found = false;  // false: no root within reach
  Vec3 p_DV_mm = Vec3::Zero();
  Vec3 normal_D = Vec3::Zero();  // of V, towards lower density, unit
};

// `place`: a proxy on H (a simplex); `contact_normal_D`: ProxyStep::normal_D.
VisualProxy FindVisualProxy(const HapticSurface& surface, const Place& place,
                            const Vec3& contact_normal_D, CellCache& cache) noexcept;

// The first point of V on the way from `from_mm` in a direction (unit). The normal is zero where V
// has none.
VisualProxy FirstOnWay(const HapticSurface& surface, const Vec3& from_D_mm, const Vec3& direction_D,
                       double reach_mm) noexcept;

}  // namespace palpate
