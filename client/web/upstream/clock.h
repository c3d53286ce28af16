// The clocks of messages. Threads: any.
#pragma once

#include <chrono>
#include <cstdint>

namespace palpate::web {

// Of the Unix epoch [ms].
inline std::int64_t NowMs() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::milliseconds>(now).count();
}

// Of this start of the machine [ns].
inline std::int64_t MonotonicNs() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::nanoseconds(now).count();
}

}  // namespace palpate::web
