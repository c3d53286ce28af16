// Converts what the servo remembers from tick to tick into the bytes of a keyframe, and back. The
// cell cache is left out: its results depend only on the surface.
//
// Threads: plain values. Real-time: Save and Load neither allocate nor lock. Apart for its tests.
#pragma once

#include <cstdint>
#include <string_view>

#include "server/haptics/renderer.h"
#include "server/haptics/tool/tool_memory.h"
#include "server/pump/tick_sample.h"
#include "server/safety/safety.h"

namespace palpate {

struct ServoMemory {
  RendererMemory renderer;
  ToolMemory tool;
  SafetyMemory safety;
  std::uint64_t tick = 0;          // the next tick
  std::uint64_t missed_ticks = 0;  // counters as of the last sample
  std::uint64_t capped_ticks = 0;
  std::uint64_t faulty_ticks = 0;
};

ServoKeyframe Save(const ServoMemory& memory) noexcept;

// Returns false for bytes that Save does not make: another length or layout, or invalid numbers.
// `memory` is then unusable.
bool Load(std::string_view bytes, ServoMemory& memory) noexcept;

}  // namespace palpate
