// Text for people: of numbers, and of what files and other machines say.
//
// Threads: any.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <string>
#include <string_view>

namespace palpate {

// Makes text of files and other machines fit for messages. A message with a string that is not
// UTF-8 could not be decoded at all.

// The length in bytes of the UTF-8 character at the start of `text`, which is not empty; 0 if there
// is none.
inline std::size_t Utf8CharacterBytes(std::string_view text) {
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return 1;
  if (lead < 0xc2 || lead > 0xf4) return 0;
  const std::size_t bytes = lead < 0xe0 ? 2 : lead < 0xf0 ? 3 : 4;
  if (text.size() < bytes) return 0;
  for (std::size_t k = 1; k < bytes; ++k) {
    if ((byte(k) & 0xc0) != 0x80) return 0;
  }
  // Invalid: overlong forms, surrogates, and values beyond Unicode.
  const bool is_none = (lead == 0xe0 && byte(1) < 0xa0) || (lead == 0xed && byte(1) >= 0xa0) ||
                       (lead == 0xf0 && byte(1) < 0x90) || (lead == 0xf4 && byte(1) >= 0x90);
  return is_none ? 0 : bytes;
}

// Replaces each byte that is not of a UTF-8 character by '?'.
inline std::string Utf8(std::string_view text) {
  std::string fit;
  fit.reserve(text.size());
  while (!text.empty()) {
    const std::size_t bytes = Utf8CharacterBytes(text);
    fit += bytes == 0 ? "?" : text.substr(0, bytes);
    text.remove_prefix(bytes == 0 ? 1 : bytes);
  }
  return fit;
}

// Makes text of files and other machines safe for messages.
//
// Replaces each control character in `text` by a space. Names and messages from files and other
// machines must not break a line or control a terminal.
inline std::string OneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return line;
}

// Numbers as text for people, who copy them into the next command.
//
// Pure. Threads: any. Errors: none.
//
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
