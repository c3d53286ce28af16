// A tour of strokes over the surface, for the simulated hand.
//
// Strokes from points all over the surface, those in the open first and long ones before dust;
// in an order of short ways through free space.
//
// Frame D (mm). Threads: pure; not real-time: some ten milliseconds, whatever the volume's size.
// The same surface gives the same plan, bit for bit.
#pragma once

#include "server/device/haptic_device.h"
#include "server/device/touch_plan.h"
#include "server/guide/touch_points.h"

namespace palpate {

// Empty where the workspace holds no surface. `cost`: what the plan took, where somebody asks.
TouchPlan PlanTouches(const HapticSurface& surface, const DeviceSpec& device,
                      double stiffness_n_per_mm, const GuideBudget& budget = {},
                      GuideCost* cost = nullptr);

}  // namespace palpate
