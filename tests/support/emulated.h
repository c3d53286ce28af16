// What emulated devices share.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

namespace palpate::test {

using Bytes = std::vector<std::uint8_t>;

// CLOCK_MONOTONIC, as in PoseSample.time_ns.
inline std::int64_t NowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace palpate::test
