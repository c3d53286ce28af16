// Makes text of files and other machines fit for messages. A message with a string that is not
// UTF-8 could not be decoded at all.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace palpate {

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

}  // namespace palpate
