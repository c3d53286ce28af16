// Where a simulated hand goes that is led along a trajectory: in contact the force deflects it. As
// palpated's led hand, without its workspace.
//
// D is the volume's world frame, mm. Threads: the calling one. The same inputs give the same bits.
// Apart for its tests.
#pragma once

#include <vector>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/settings.h"

namespace palpate::lab {

// One target and one HIP per millisecond. The hand begins at rest at the first target. Throws Error
// (kInvalidArgument) if there is no target, or one is not finite.
std::vector<Vec3> HipsOfLedHand(const HapticSurface& surface, const HapticSettings& settings,
                                const std::vector<Vec3>& targets_mm);

}  // namespace palpate::lab
