// A tick as the servo has it, and as recordings have it.
//
// Frames and units: as in TickSample. Threads: pure. Neither allocates.
#pragma once

#include "common/contract/recorded.h"
#include "server/pump/tick_sample.h"

namespace palpate {

// Why a recording with other hands than 0 is refused.
inline constexpr const char* kSeveralHands =
    "of several hands, which this program cannot replay: a newer one wrote it";

RecordedTick RecordedTickOf(const TickSample& sample);
// Throws DamagedBytes for an enumerator that this version does not know.
TickSample SampleOf(const RecordedTick& tick);

}  // namespace palpate
