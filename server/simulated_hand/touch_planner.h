// A tour of strokes over the surface, for the simulated hand.
//
// The strokes begin at points all over the surface. Strokes in the open come before those in narrow
// places, and long ones before dust. Their order makes the ways through free space short.
//
// Frame D (mm). Threads: pure; not real-time: tens of milliseconds for the volumes that were tried.
// The same surface gives the same plan, bit for bit.
#pragma once

#include "server/device/haptic_device.h"
#include "server/simulated_hand/touch_plan.h"
#include "server/simulated_hand/touch_points.h"

namespace palpate {

// Empty where the workspace holds no surface. `cost`: what the plan took, where somebody asks.
TouchPlan PlanTouches(const HapticSurface& surface, const DeviceDescription& device,
                      double stiffness_n_per_mm, const GuideBudget& budget = {},
                      GuideCost* cost = nullptr);

}  // namespace palpate
