// The servo's state before a tick, as bytes. Ticks can be computed again from a keyframe, the
// scenes and the inputs, bit for bit. server/servo/servo_memory.h makes and reads the bytes.
//
// The servo makes a keyframe every kKeyframeTicks ticks without being asked, in 0.1 us. This needs
// no flag and no wait between threads, and every run does the same whether it is recorded or not. A
// recorder keeps only the keyframes that it needs: the first, one after each gap, and one a second.
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
  static constexpr std::size_t kBytes = 2400;

  std::uint64_t tick = 0;  // the tick that starts from this state
  std::size_t size = 0;    // of the bytes that are used
  std::array<char, kBytes> bytes{};

  std::string_view view() const { return {bytes.data(), size}; }
};
static_assert(std::is_trivially_copyable_v<ServoKeyframe>);

}  // namespace palpate
