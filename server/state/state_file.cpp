#include "server/state/state_file.h"

#include <fmt/core.h>

#include <fstream>
#include <sstream>

#include "common/error/error.h"
#include "common/error/one_line.h"
#include "common/files/new_file.h"

namespace palpate {
namespace {

// A thousand entries with the longest paths take 5 MB.
constexpr std::uintmax_t kMostBytes = 16 << 20;

// Writes strings with escapes only. The library's literal and multi-line strings cannot hold every
// path.
std::string ToText(const toml::table& table) {
  std::ostringstream text;
  text << toml::toml_formatter{table, toml::format_flags::allow_unicode_strings};
  return text.str();
}

}  // namespace

StateFile ReadStateFile(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) return {};
  if (status.type() != std::filesystem::file_type::regular) return {{}, "it is not a regular file"};
  if (std::filesystem::file_size(path, error) > kMostBytes) return {{}, "it is too long"};
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  // Copying an empty file would set the fail bit of `text`.
  if (file.peek() != std::ifstream::traits_type::eof()) text << file.rdbuf();
  if (!file.is_open() || file.bad()) return {{}, "it cannot be read"};
  try {
    return {toml::parse(text.str()), ""};
  } catch (const toml::parse_error& parse) {
    return {{},
            fmt::format("line {}: {}", parse.source().begin.line, OneLine(parse.description()))};
  }
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
