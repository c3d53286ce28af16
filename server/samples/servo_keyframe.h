// All that the next tick depends on besides scene and input, as bytes: from there the
// ticks can be computed again, bit for bit. server/servo/servo_memory.h makes and reads them.
//
// The servo makes one every kKeyframeTicks ticks, of itself and unasked: 0.1 us a time,
// no flag and no wait between threads, and every run does the same whether it is
// recorded or not. Whoever records keeps those that it needs: where it begins, after
// each gap, and one a second.
//
// Threads: plain values.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

namespace palpate {

inline constexpr std::uint64_t kKeyframeTicks = 64;

// Trivially copyable: it goes through a ring to the pump thread.
struct ServoKeyframe {
  static constexpr std::size_t kBytes = 986;

  std::uint64_t tick = 0;  // it is the state before this tick
  std::array<char, kBytes> bytes{};

  std::string_view view() const { return {bytes.data(), bytes.size()}; }
};
static_assert(std::is_trivially_copyable_v<ServoKeyframe>);

}  // namespace palpate
