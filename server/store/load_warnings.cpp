#include "server/store/load_warnings.h"

#include <cstddef>

#include "common/error/one_line.h"

namespace palpate {
namespace {

constexpr std::size_t kMostLines = 16;
constexpr std::size_t kMostBytes = 300;

// The length in bytes of the UTF-8 character at the start; 0 if there is none.
std::size_t CharacterBytes(std::string_view text) {
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

// A message with a string that is not UTF-8 could not be decoded at all.
std::string Fit(std::string_view text) {
  std::string fit;
  while (!text.empty()) {
    const std::size_t bytes = CharacterBytes(text);
    const std::string_view next = bytes == 0 ? "?" : text.substr(0, bytes);
    if (fit.size() + next.size() > kMostBytes) break;
    fit += next;
    text.remove_prefix(next.size());
  }
  return OneLine(fit);
}

}  // namespace

std::vector<std::string> WarningsForClients(std::span<const std::string> warnings,
                                            std::string_view source) {
  const std::string prefix = std::string(source) + ": ";
  const std::size_t shown = warnings.size() > kMostLines ? kMostLines - 1 : warnings.size();
  std::vector<std::string> lines;
  for (std::string_view warning : warnings.first(shown)) {
    if (warning.starts_with(prefix)) warning.remove_prefix(prefix.size());
    lines.push_back(Fit(warning));
  }
  if (shown < warnings.size()) {
    lines.push_back("and " + std::to_string(warnings.size() - shown) + " more");
  }
  return lines;
}

}  // namespace palpate
