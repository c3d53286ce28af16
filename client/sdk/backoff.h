// Pauses between attempts. Each pause is twice as long as the one before, up to the longest. Each
// pause is shortened at random by up to a half, so that many clients of one daemon do not come back
// at once.
//
// Threads: one.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>

namespace palpate::client {

class Backoff {
 public:
  static constexpr std::chrono::milliseconds kFirst{100};
  static constexpr std::chrono::milliseconds kLongest{5000};

  explicit Backoff(std::uint64_t seed = std::random_device{}()) : random_(seed) {}

  // The pause before the next attempt: in (p/2, p] for p = 0.1, 0.2, 0.4 ... 5 s.
  std::chrono::milliseconds Next() {
    const auto pause = pause_;
    pause_ = std::min(pause_ * 2, kLongest);
    std::uniform_int_distribution<std::int64_t> cut(0, pause.count() / 2 - 1);
    return pause - std::chrono::milliseconds(cut(random_));
  }
  // Call it after a success.
  void Reset() { pause_ = kFirst; }

 private:
  std::mt19937_64 random_;
  std::chrono::milliseconds pause_ = kFirst;
};

}  // namespace palpate::client
