// The servo thread's output: its samples and keyframes, and its newest tick.
//
// Threads: the servo thread pushes and tells; the pump thread pops; any ordinary thread reads
// `last`. Real-time: pushing and telling are wait-free. Items that do not fit are counted and lost.
#pragma once

#include "server/pump/last_tick.h"
#include "server/pump/servo_keyframe.h"
#include "server/pump/tick_sample.h"
#include "server/realtime/spsc_ring.h"

namespace palpate {

class TickOutbox : public SpscRing<TickSample, 4096> {  // four seconds
 public:
  // One keyframe every kKeyframeTicks, pushed before the sample of its tick.
  SpscRing<ServoKeyframe, 64> keyframes;
  // Updated after each tick; holds the newest tick even if the rings are full.
  LastTickBoard last;
};

}  // namespace palpate
