// TOML files that the daemon keeps for itself.
//
// Threads: any; not for real-time code.
#pragma once

#include <toml++/toml.h>
#include <filesystem>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

struct StateFile {
  toml::table table;
  std::string damage;  // what is wrong with the file, one line; empty: no damage
};

// Returns an empty table if there is no such file. Throws Error if the file cannot be read for a
// reason that may pass, such as too many open files.
StateFile ReadStateFile(const std::filesystem::path& path);

// Afterwards the file is either complete or unchanged. Makes the folder if it is missing. `remark`:
// lines that begin with #. Throws Error (kUnavailable).
void WriteStateFile(const std::filesystem::path& path, const std::string& remark,
                    const toml::table& table);

// False if `text` is not UTF-8: TOML files are UTF-8, but a path need not be.
bool HoldsAsToml(const std::string& text);

template <typename Values>
toml::array ToTomlArray(const Values& values) {
  toml::array array;
  for (const auto value : values) array.push_back(value);
  return array;
}

// `number` must be a number. toml++ gives no double for an integer that no double holds exactly.
double ToDouble(const toml::node& number);
// Returns none if the value is no number (TomlNumbers: no array of kCount numbers).
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
