// Values of the contract as JSON: an object with every field of the contract, by its name.
//
// Vectors are lists (a quaternion: w, x, y, z), enumerators are their words, and what is absent is
// null. Threads: pure functions; any. Not for real-time code.
#pragma once

#include <concepts>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "common/contract/enumeration.h"
#include "common/geometry/geometry.h"

namespace palpate {

using Json = nlohmann::ordered_json;

inline Json ToJson(const Vec3& vector) { return {vector.x(), vector.y(), vector.z()}; }
inline Json ToJson(const Vec3i& vector) { return {vector.x(), vector.y(), vector.z()}; }
inline Json ToJson(const UnalignedQuaternion& q) { return {q.w(), q.x(), q.y(), q.z()}; }
inline Json ToJson(const AffineMap& map) {
  Json linear = Json::array();
  for (int n = 0; n < 9; ++n) linear.push_back(map.linear(n / 3, n % 3));
  return {{"linear", linear}, {"translation", ToJson(map.translation)}};
}

template <class Value>
Json ToJson(const Value& value);

template <class Value>
Json ToJson(const std::optional<Value>& value) {
  return value ? ToJson(*value) : Json();
}

template <class Value>
Json ToJson(const std::vector<Value>& values) {
  Json list = Json::array();
  for (const Value& value : values) list.push_back(ToJson(value));
  return list;
}

template <class Value>
Json ToJson(const Value& value) {
  if constexpr (std::is_enum_v<Value>) {
    return NameOf(value);
  } else if constexpr (std::is_arithmetic_v<Value> || std::same_as<Value, std::string>) {
    return value;
  } else {
    Json object = Json::object();
    VisitFields(value, [&](const char* name, const auto& field) { object[name] = ToJson(field); });
    return object;
  }
}

}  // namespace palpate
