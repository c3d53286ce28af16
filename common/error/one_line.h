// Text of files and other machines, made fit for a message.
#pragma once

#include <string>
#include <string_view>

namespace palpate {

// `text` with each control character replaced by a space: names and messages come from files and
// other machines, and must neither break a line nor steer a terminal.
inline std::string OneLine(std::string_view text) {
  std::string line(text);
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return line;
}

}  // namespace palpate
