// A value of the configuration file.
//
// Threads: main. Errors: Error (kInvalidArgument) that says what is wrong. The caller adds the
// file's name, the line and the key.
#pragma once

#include <fmt/core.h>

#include <toml++/toml.h>
#include <string>

#include "common/error/error.h"
#include "common/geometry/geometry.h"
#include "server/state/state_file.h"

namespace palpate {

struct ConfigEntry {
  const toml::node& node;

  [[noreturn]] static void Fail(const std::string& what) {
    throw Error(ErrorKind::kInvalidArgument, what);
  }
  std::string Text() const {
    if (const auto value = node.value_exact<std::string>()) return *value;
    Fail("must be a text in quotes");
  }
  double Number() const {
    if (node.is_number()) return ToDouble(node);
    Fail("must be a number");
  }
  int Integer(int low, int high) const {
    const auto value = node.value_exact<std::int64_t>();
    if (value && *value >= low && *value <= high) return static_cast<int>(*value);
    Fail(fmt::format("must be a whole number from {} to {}", low, high));
  }
  bool Flag() const {
    if (const auto value = node.value_exact<bool>()) return *value;
    Fail("must be true or false");
  }
  Vec3 Triple() const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != 3) Fail("must be three numbers, [x, y, z]");
    Vec3 v;
    for (std::size_t n = 0; n < 3; ++n) {
      if (!(*array)[n].is_number()) Fail("must be three numbers, [x, y, z]");
      v[static_cast<Eigen::Index>(n)] = ToDouble((*array)[n]);
    }
    return v;
  }
};

}  // namespace palpate
