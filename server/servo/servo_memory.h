// What the servo remembers from tick to tick, to the bytes of a keyframe and back. The cache of
// cells is left out: what it returns depends on the surface alone.
//
// Threads: plain values. Real-time: Save and Load neither allocate nor lock.
#pragma once

#include <cstdint>
#include <string_view>

#include "server/haptics/renderer.h"
#include "server/safety/safety.h"
#include "server/samples/servo_keyframe.h"

namespace palpate {

struct ServoMemory {
  RendererMemory renderer;
  SafetyMemory safety;
  std::uint64_t tick = 0;          // the next one
  std::uint64_t missed_ticks = 0;  // counters as of the last sample
  std::uint64_t capped_ticks = 0;
  std::uint64_t faulty_ticks = 0;
};

ServoKeyframe Save(const ServoMemory& memory) noexcept;

// False, and `memory` is of no use, for what Save does not make: other lengths and
// layouts, numbers that are no state.
bool Load(std::string_view bytes, ServoMemory& memory) noexcept;

}  // namespace palpate
