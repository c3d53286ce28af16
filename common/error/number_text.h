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

// All digits that matter: twelve, and six behind the point, which leaves out what sums have
// rounded. Of a number that was a float, the fewest that give the same float, unless these give it.
inline std::string NumberText(double number) {
  const double places = 7.0 + std::floor(std::log10(std::abs(number)));  // not a number: 12
  const int digits = places > 12.0 ? static_cast<int>(std::min(places, 17.0)) : 12;
  char text[32];
  char* end =
      std::to_chars(std::begin(text), std::end(text), number, std::chars_format::general, digits)
          .ptr;
  double read = number;
  std::from_chars(text, end, read);
  const bool fits = std::abs(number) <= std::numeric_limits<float>::max();
  const float as_float = fits ? static_cast<float>(number) : 0.0f;
  if (read != number && static_cast<double>(as_float) == number) {
    end = std::to_chars(std::begin(text), std::end(text), as_float).ptr;
  }
  return {text, end};
}

}  // namespace palpate
