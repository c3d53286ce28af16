// Leads the renderer along a trajectory, one HIP per tick, at full speed.
//
// D is the volume's world frame: X_DI is its WorldFromIndex. Replay() judges nothing, so the update
// times are the renderer's alone.
// Threads: the calling one. Errors: Error.
#pragma once

#include <cstdint>
#include <vector>

#include "server/haptics/haptic_surface.h"
#include "server/haptics/renderer.h"

namespace palpate::lab {

inline constexpr double kReplayPeriodS = 1e-3;

struct ReplayTick {
  Vec3 p_DHip_mm = Vec3::Zero();  // as given; may be not finite
  bool placed = false;            // this HIP or an earlier one was finite
  HapticOutput output;
  VisualProxy visual;
  std::int64_t update_ns = 0;
};

inline bool IsInContact(const HapticOutput& output) { return !output.proxy.normal_D.isZero(0.0); }

// `passes`: number of identical passes, at least 1. For each tick, the shortest time counts. Throws
// kInternal if the passes give different results.
std::vector<ReplayTick> Replay(const HapticSurface& surface, const HapticSettings& settings,
                               const std::vector<Vec3>& hips_mm, int passes);

}  // namespace palpate::lab
