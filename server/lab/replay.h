// Leads the renderer along a trajectory, one HIP a tick, as fast as it goes.
//
// D is the volume's world frame: X_DI is its WorldFromIndex. Nothing is judged
// here, so that update times are those of the renderer alone.
// Threads: the calling one. Errors: Error.
#pragma once

#include <cstdint>
#include <vector>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/renderer.h"

namespace palpate::lab {

inline constexpr double kReplayPeriodS = 1e-3;

struct ReplayTick {
  Vec3 p_DHip_mm = Vec3::Zero();  // as given; maybe not finite
  bool placed = false;            // there was a finite HIP already
  HapticOutput output;
  std::int64_t update_ns = 0;
};

inline bool IsInContact(const HapticOutput& output) { return !output.proxy.normal_D.isZero(0.0); }

// `passes`, at least 1: identical ones, of which the least time of each tick
// counts. kInternal where they were not identical.
std::vector<ReplayTick> Replay(const HapticSurface& surface, const HapticSettings& settings,
                               const std::vector<Vec3>& hips_mm, int passes);

}  // namespace palpate::lab
