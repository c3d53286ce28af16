// The least and the greatest of many numbers.
//
// Threads: pure, any.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <utility>

namespace palpate {

// Ignores NaN. Compares many numbers side by side, so that the compiler uses vector instructions.
template <class Number>
std::pair<Number, Number> RangeOf(const Number* values, std::size_t count) {
  constexpr std::size_t kLanes = 64;
  std::array<Number, kLanes> least, greatest;
  least.fill(std::numeric_limits<Number>::max());
  greatest.fill(std::numeric_limits<Number>::lowest());
  for (; count >= kLanes; values += kLanes, count -= kLanes) {
    for (std::size_t k = 0; k < kLanes; ++k) {
      // Not std::min: its references keep the compiler from it.
      const Number value = values[k];
      least[k] = value < least[k] ? value : least[k];
      greatest[k] = value > greatest[k] ? value : greatest[k];
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    least[k] = std::min(least[k], values[k]);
    greatest[k] = std::max(greatest[k], values[k]);
  }
  return {*std::min_element(least.begin(), least.end()),
          *std::max_element(greatest.begin(), greatest.end())};
}

}  // namespace palpate
