// What clients see of a tick.
//
// Frames and units: as in palpate.v1.PoseSample. Threads: pure functions; any. Real-time: neither
// allocates.
#pragma once

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/contract/pose.h"
#include "server/pump/tick_sample.h"

namespace palpate {

PoseSample PoseOf(const TickSample& sample);

// `forces`: as the safety stage has them. `replay`: a recording is replayed to viewers, so nothing
// acts.
ForceStatus ForcesOf(ForceStatus forces, bool replay);

}  // namespace palpate
