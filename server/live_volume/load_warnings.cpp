#include "server/live_volume/load_warnings.h"

#include <cstddef>

#include "common/error/one_line.h"
#include "common/error/utf8.h"

namespace palpate {
namespace {

constexpr std::size_t kMostLines = 16;
constexpr std::size_t kMostBytes = 300;

std::string Fit(std::string_view text) {
  std::string fit;
  while (!text.empty()) {
    const std::size_t bytes = Utf8CharacterBytes(text);
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
