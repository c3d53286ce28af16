// One stroke of the hand over the surface, from a point on it.
//
// The stroke follows the surface straight ahead, both ways, in the direction in which it gets
// farthest: along a vessel, not round it. It ends at an edge, where other material is too near,
// and at the border of the workspace. A grain of dust is a stroke of one point.
//
// The hand is to be below the surface by what gives a gentle force, but no deeper than the middle
// of something thin: there, it could leave on the far side.
//
// Frame D (mm). Threads: pure; not real-time.
#pragma once

#include "server/device/haptic_device.h"
#include "server/simulated_hand/touch_planner.h"
#include "server/simulated_hand/touch_points.h"

namespace palpate {

// The greatest depth of a hand below the surface.
double PressDepthMm(double stiffness_n_per_mm);

TouchStroke MakeStroke(SurfaceProbe& probe, const SurfacePoint& start,
                       const DeviceDescription& device, double depth_mm);

double LengthMm(const TouchStroke& stroke);

// Whether the stroke's hand stays in the material, as far as the device can tell positions apart.
bool IsSteady(SurfaceProbe& probe, const TouchStroke& stroke, const DeviceDescription& device);

}  // namespace palpate
