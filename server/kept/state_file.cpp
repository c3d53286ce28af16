#include "server/kept/state_file.h"

#include <fmt/core.h>

#include <sstream>

#include "common/error/error.h"
#include "common/error/text.h"
#include "common/files/new_file.h"
#include "common/files/text_file.h"

namespace palpate {
namespace {

// A thousand entries with the longest paths take 5 MB.
constexpr std::size_t kMostBytes = 16 << 20;

// Writes strings with escapes only. The library's literal and multi-line strings cannot hold every
// path.
std::string ToText(const toml::table& table) {
  std::ostringstream text;
  text << toml::toml_formatter{table, toml::format_flags::allow_unicode_strings};
  return text.str();
}

}  // namespace

StateFile ReadStateFile(const std::filesystem::path& path) try {
  return {toml::parse(ReadTextFile(path, kMostBytes)), ""};
} catch (const toml::parse_error& parse) {
  return {{}, fmt::format("line {}: {}", parse.source().begin.line, OneLine(parse.description()))};
} catch (const Error& error) {
  if (error.kind() == ErrorKind::kNotFound) return {};
  if (error.kind() == ErrorKind::kInvalidArgument) return {{}, error.what()};
  throw;
}

void WriteStateFile(const std::filesystem::path& path, const std::string& remark,
                    const toml::table& table) {
  const std::string text = remark + (table.empty() ? std::string() : ToText(table)) + "\n";
  MakeFolders(path.parent_path());
  NewFile file(std::filesystem::weakly_canonical(path));  // a file behind a link
  file.Write(text);
  file.TakeName();
}

bool HoldsAsToml(const std::string& text) {
  try {
    const toml::table table = toml::parse(ToText(toml::table{{"text", text}}));
    return table["text"].value_exact<std::string>() == text;
  } catch (const toml::parse_error&) {
    return false;
  }
}

double ToDouble(const toml::node& number) {
  if (const auto* integer = number.as_integer()) return static_cast<double>(integer->get());
  return number.as_floating_point()->get();
}

std::optional<double> TomlNumber(const toml::table& table, std::string_view key) {
  const toml::node* node = table[key].node();
  if (!node || !node->is_number()) return std::nullopt;
  return ToDouble(*node);
}

}  // namespace palpate
