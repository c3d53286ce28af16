// The servo thread's way out: its samples and keyframes, and its newest tick.
//
// Threads: the servo's pushes and tells, the pump's pops; last is read on any ordinary
// one. Real-time: pushing and telling are wait-free; what does not fit is counted and lost.
#pragma once

#include "server/realtime/spsc_ring.h"
#include "server/samples/last_tick.h"
#include "server/samples/servo_keyframe.h"
#include "server/samples/tick_sample.h"

namespace palpate {

class TickOutbox : public SpscRing<TickSample, 4096> {  // four seconds
 public:
  // One every kKeyframeTicks; pushed before the sample of its tick.
  SpscRing<ServoKeyframe, 64> keyframes;
  // After each tick; it holds the newest, however full the rings are.
  LastTickBoard last;
};

}  // namespace palpate
