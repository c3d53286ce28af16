// A tick as the servo has it, and as recordings have it.
//
// Frames and units: as in TickSample. Threads: pure. Neither allocates.
#pragma once

#include "common/contract/recorded.h"
#include "server/samples/tick_sample.h"

namespace palpate {

RecordedTick RecordedTickOf(const TickSample& sample);
// Throws DamagedBytes for an enumerator that this version does not know.
TickSample SampleOf(const RecordedTick& tick);

}  // namespace palpate
