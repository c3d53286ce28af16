// Numbers as text for people, who copy them into the next command.
//
// Pure. Threads: any. Errors: none.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>
#include <string>

namespace palpate {

// All digits that matter: of a number that was a float, the fewest that give the same float; of
// others twelve, and six behind the point, which leaves out what sums have rounded.
inline std::string NumberText(double number) {
  char text[32];
  const bool fits = std::abs(number) <= std::numeric_limits<float>::max();
  const float as_float = fits ? static_cast<float>(number) : 0.0f;
  const double places = 7.0 + std::floor(std::log10(std::abs(number)));  // not a number: 12
  const int digits = places > 12.0 ? static_cast<int>(std::min(places, 17.0)) : 12;
  const auto end = fits && static_cast<double>(as_float) == number
                       ? std::to_chars(std::begin(text), std::end(text), as_float)
                       : std::to_chars(std::begin(text), std::end(text), number,
                                       std::chars_format::general, digits);
  return {text, end.ptr};
}

}  // namespace palpate
