// Makes text of files and other machines safe for messages.
#pragma once

#include <string>
#include <string_view>

namespace palpate {

// Replaces each control character in `text` by a space. Names and messages from files and other
// machines must not break a line or control a terminal.
inline std::string OneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return line;
}

}  // namespace palpate
