#include "server/session/registration_file.h"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <fstream>
#include <optional>
#include <sstream>

#include "common/error/error.h"
#include "server/volume/whole_file.h"

namespace palpate {
namespace {

// A thousand entries with the longest paths have 5 MB.
constexpr std::uintmax_t kMostBytes = 16 << 20;
constexpr const char* kTable = "registration";

template <typename Vector>
toml::array ToArray(const Vector& values) {
  toml::array array;
  for (const auto value : values) array.push_back(value);
  return array;
}

toml::table ToTable(const StoredRegistration& entry) {
  const Eigen::Quaterniond& q = entry.R_DW;
  return toml::table{
      {"source", entry.source},
      {"size", ToArray(entry.size.cast<std::int64_t>())},
      {"spacing_mm", ToArray(entry.spacing_mm)},
      {"center_mm", ToArray(entry.p_DCenter_mm)},
      {"rotation_wxyz", ToArray(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()))},
      {"device_mm_per_volume_mm", entry.device_mm_per_volume_mm},
  };
}

template <int kCount>
std::optional<Eigen::Matrix<double, kCount, 1>> Numbers(const toml::table& table, const char* key) {
  const toml::array* array = table[key].as_array();
  if (!array || array->size() != kCount) return std::nullopt;
  Eigen::Matrix<double, kCount, 1> numbers;
  for (int n = 0; n < kCount; ++n) {
    const toml::node& node = (*array)[static_cast<std::size_t>(n)];
    if (!node.is_number()) return std::nullopt;
    numbers[n] = *node.value<double>();
  }
  return numbers;
}

// Whether such a registration is one is for MakeRegistration to say.
std::optional<StoredRegistration> ToEntry(const toml::node& node) {
  const toml::table* table = node.as_table();
  if (!table) return std::nullopt;
  const auto source = (*table)["source"].value_exact<std::string>();
  const auto size = Numbers<3>(*table, "size");
  const auto spacing_mm = Numbers<3>(*table, "spacing_mm");
  const auto center_mm = Numbers<3>(*table, "center_mm");
  const auto rotation = Numbers<4>(*table, "rotation_wxyz");
  const toml::node* scale = (*table)["device_mm_per_volume_mm"].node();
  if (!source || !size || !spacing_mm || !center_mm || !rotation || !scale || !scale->is_number()) {
    return std::nullopt;
  }
  StoredRegistration entry;
  entry.source = *source;
  // Of any other number no volume is.
  if ((size->array() >= 1.0).all() && (size->array() <= 1e9).all()) entry.size = size->cast<int>();
  entry.spacing_mm = *spacing_mm;
  entry.p_DCenter_mm = *center_mm;
  entry.R_DW = Eigen::Quaterniond((*rotation)[0], (*rotation)[1], (*rotation)[2], (*rotation)[3]);
  entry.device_mm_per_volume_mm = *scale->value<double>();
  return entry;
}

void Take(const toml::table& file, RegistrationFile& result) {
  if (file.empty()) return;
  const toml::array* entries = file[kTable].as_array();
  if (!entries) {
    result.damage = fmt::format("there is no [[{}]] in it", kTable);
    return;
  }
  for (const toml::node& node : *entries) {
    if (auto entry = ToEntry(node)) {
      result.entries.push_back(*std::move(entry));
    } else {
      result.damage = fmt::format("the entry at line {} is incomplete", node.source().begin.line);
    }
  }
}

// Strings with escapes only: the library's literal and multi-line ones do not hold
// every path.
std::string ToText(const toml::table& table) {
  std::ostringstream text;
  text << toml::toml_formatter{table, toml::format_flags::allow_unicode_strings};
  return text.str();
}

bool HoldsAsToml(const std::string& source) {
  try {
    const toml::table table = toml::parse(ToText(toml::table{{"source", source}}));
    return table["source"].value_exact<std::string>() == source;
  } catch (const toml::parse_error&) {
    return false;
  }
}

}  // namespace

RegistrationFile ReadRegistrations(const std::filesystem::path& path) {
  RegistrationFile result;
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::not_found) return result;
  if (status.type() != std::filesystem::file_type::regular) {
    result.damage = "it is no file";
    return result;
  }
  if (std::filesystem::file_size(path, error) > kMostBytes) {
    result.damage = "it is too long";
    return result;
  }
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  // An empty file sets the fail bit of the one it is written to.
  if (file.peek() != std::ifstream::traits_type::eof()) text << file.rdbuf();
  if (!file.is_open() || file.bad()) {
    result.damage = "it cannot be read";
    return result;
  }
  try {
    Take(toml::parse(text.str()), result);
  } catch (const toml::parse_error& parse) {
    result.damage = fmt::format("line {}: {}", parse.source().begin.line, parse.description());
  }
  return result;
}

void WriteRegistrations(const std::filesystem::path& path,
                        const std::vector<StoredRegistration>& entries) {
  toml::array array;
  for (const StoredRegistration& entry : entries) {
    if (HoldsAsToml(entry.source)) array.push_back(ToTable(entry));
  }
  const std::string text =
      "# Where volumes lie in the workspace of the device, the oldest first. Written by\n"
      "# palpated, which takes up changes when it starts.\n" +
      (array.empty() ? std::string() : ToText(toml::table{{kTable, std::move(array)}})) + "\n";
  std::error_code error;
  std::filesystem::create_directories(path.parent_path(), error);
  if (error) {
    throw Error(ErrorKind::kUnavailable,
                "cannot make the folder " + path.parent_path().string() + ": " + error.message());
  }
  WriteWhole(path, [&](const std::filesystem::path& partial) {
    std::ofstream file;
    file.exceptions(std::ios::failbit | std::ios::badbit);
    file.open(partial, std::ios::binary | std::ios::trunc);
    file << text;
    file.close();
  });
}

}  // namespace palpate
