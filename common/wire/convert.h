// Converts values of common from and to messages of palpate.v1. Copies the numbers as they are;
// units and frames are the caller's. Any thread.
#pragma once

#include <cstdint>

#include "common/geometry/geometry.h"
#include "palpate/v1/geometry.pb.h"

namespace palpate {

v1::Vector3 ToProto(const Vec3& vector);
v1::Quaternion ToProto(const Eigen::Quaterniond& rotation);
v1::AffineMap ToProto(const AffineMap& map);

Vec3 FromProto(const v1::Vector3& vector);
// Does not normalise.
Eigen::Quaterniond FromProto(const v1::Quaternion& rotation);
// Errors: kInvalidArgument if `linear` does not have nine values.
AffineMap FromProto(const v1::AffineMap& map);

// Numbers of voxels, and their indices. Errors: kInvalidArgument for one that does not fit.
int FromCount(std::uint32_t count);
std::uint32_t ToCount(int count);

}  // namespace palpate
