// Converts values of common from and to messages of palpate.v1. Copies the numbers as they are;
// units and frames are the caller's. Any thread.
#pragma once

#include <google/protobuf/generated_enum_reflection.h>

#include <optional>

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "palpate/v1/geometry.pb.h"
#include "palpate/v1/render.pb.h"

namespace palpate {

// For enumerations with the same enumerators in the same order; protobuf's 0 is unspecified.
template <class Proto, class Enum>
constexpr Proto EnumToProto(Enum value) {
  return static_cast<Proto>(static_cast<int>(value) + 1);
}

// None for 0, and for a number of another version.
template <class Enum, class Proto>
std::optional<Enum> EnumFromProto(Proto value) {
  const bool is_known =
      value != 0 && google::protobuf::GetEnumDescriptor<Proto>()->FindValueByNumber(value);
  return is_known ? std::optional(static_cast<Enum>(static_cast<int>(value) - 1)) : std::nullopt;
}

v1::Vector3 ToProto(const Vec3& vector);
v1::Quaternion ToProto(const Eigen::Quaterniond& rotation);
v1::AffineMap ToProto(const AffineMap& map);
v1::DecompositionMethod ToProto(DecompositionMethod method);

Vec3 FromProto(const v1::Vector3& vector);
// Does not normalise.
Eigen::Quaterniond FromProto(const v1::Quaternion& rotation);
// Errors: kInvalidArgument if `linear` does not have nine values.
AffineMap FromProto(const v1::AffineMap& map);
// Errors: kInvalidArgument for a method of another version.
DecompositionMethod FromProto(v1::DecompositionMethod method);

}  // namespace palpate
