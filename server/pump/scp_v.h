// SCP_V of a tick, which no force depends on: whoever shows or records ticks adds it.
//
// Threads: one for each cache. Not for the servo thread.
#pragma once

#include "server/felt/scene.h"
#include "server/haptics/cell_cache.h"
#include "server/pump/tick_sample.h"

namespace palpate {

// `sample`: as the servo computed it, with `scene`. Another scene gives a wrong SCP_V.
void AddScpV(const Scene& scene, CellCache& cache, TickSample& sample) noexcept;

}  // namespace palpate
