// What clients see of a tick.
//
// Frames and units: as in palpate.v1.PoseSample. Threads: pure functions; any. Real-time: neither
// allocates.
#pragma once

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/contract/pose.h"
#include "server/felt/scene.h"
#include "server/haptics/cell_cache.h"
#include "server/haptics/visual_proxy.h"
#include "server/pump/tick_sample.h"

namespace palpate {

// The point where a ball touches the isosurface V that stops it.
//
// It is the first point of V on the way to where the sphere has the volume's greatest felt density:
// the sphere itself is known to a fraction of a voxel only. If V is not met there, it is the
// nearest point that is met on other ways. In a crease the ball touches several points; this is one
// of them, and goes from one to another.
//
// Frame: D (mm). Threads: pure; bounded, about 10 us. Not for the servo thread.
//
// `surface`: of the volume, with the τ that stops the ball.
VisualProxy FindTouchedPoint(const HapticSurface& surface, const Vec3& center_D_mm,
                             double radius_mm) noexcept;

// SCP_V of a tick, which no force depends on: whoever shows or records ticks adds it.
//
// Threads: one for each cache. Not for the servo thread.
//
// `sample`: as the servo computed it, with `scene`. Another scene gives a wrong SCP_V.
void AddScpV(const Scene& scene, CellCache& cache, TickSample& sample) noexcept;

PoseSample PoseOf(const TickSample& sample);

// `forces`: as the safety stage has them. `replay`: a recording is replayed to viewers, so nothing
// acts.
ForceStatus ForcesOf(ForceStatus forces, bool replay);

}  // namespace palpate
