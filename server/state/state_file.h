// TOML files that the daemon keeps for itself.
//
// Any thread; not for real-time code.
#pragma once

#include <toml++/toml.h>
#include <filesystem>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

struct StateFile {
  toml::table table;
  std::string damage;  // why nothing could be read, one line; empty: it could
};

// Empty where there is no such file.
StateFile ReadStateFile(const std::filesystem::path& path);

// The file is whole or as it was; its folder is made where it is missing. `remark`:
// lines that begin with #. Throws Error (kUnavailable).
void WriteStateFile(const std::filesystem::path& path, const std::string& remark,
                    const toml::table& table);

// A path need not be UTF-8, which a TOML file is.
bool HoldsAsToml(const std::string& text);

template <typename Values>
toml::array ToTomlArray(const Values& values) {
  toml::array array;
  for (const auto value : values) array.push_back(value);
  return array;
}

// Of a node that is a number. toml++ gives no double for an integer that none holds exactly.
double ToDouble(const toml::node& number);
// None where it is no number, or not so many of them.
std::optional<double> TomlNumber(const toml::table& table, std::string_view key);
template <int kCount>
std::optional<Eigen::Matrix<double, kCount, 1>> TomlNumbers(const toml::table& table,
                                                            std::string_view key) {
  const toml::array* array = table[key].as_array();
  if (!array || array->size() != kCount) return std::nullopt;
  Eigen::Matrix<double, kCount, 1> numbers;
  for (int n = 0; n < kCount; ++n) {
    const toml::node& node = (*array)[static_cast<std::size_t>(n)];
    if (!node.is_number()) return std::nullopt;
    numbers[n] = ToDouble(node);
  }
  return numbers;
}

}  // namespace palpate
