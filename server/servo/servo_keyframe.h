// All that the next tick depends on besides scene and input, as bytes: from there the
// ticks can be computed again, bit for bit.
//
// The servo makes one every kKeyframeTicks ticks, of itself and unasked: 0.1 us a time,
// no flag and no wait between threads, and every run does the same whether it is
// recorded or not. Whoever records keeps those that it needs: where it begins, after
// each gap, and one a second. The cache of cells is left out: what it returns
// depends on the surface alone.
//
// Threads: plain values. Real-time: Save and Load neither allocate nor lock.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "common/geometry/geometry.h"
#include "server/haptics/renderer.h"
#include "server/safety/safety.h"

namespace palpate {

inline constexpr std::uint64_t kKeyframeTicks = 64;

struct ServoMemory {
  RendererMemory renderer;
  SafetyMemory safety;
  std::uint64_t tick = 0;          // the next one
  std::uint64_t missed_ticks = 0;  // counters as of the last sample
  std::uint64_t capped_ticks = 0;
  std::uint64_t faulty_ticks = 0;
};

// Trivially copyable: it goes through a ring to the pump thread.
struct ServoKeyframe {
  static constexpr std::size_t kBytes = 986;

  std::uint64_t tick = 0;  // it is the state before this tick
  std::array<char, kBytes> bytes{};

  std::string_view view() const { return {bytes.data(), bytes.size()}; }
};
static_assert(std::is_trivially_copyable_v<ServoKeyframe>);

ServoKeyframe Save(const ServoMemory& memory) noexcept;

// False, and `memory` is of no use, for what Save does not make: other lengths and
// layouts, numbers that are no state.
bool Load(std::string_view bytes, ServoMemory& memory) noexcept;

}  // namespace palpate
