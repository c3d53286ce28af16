// Values of common <-> messages of palpate.v1. Units and frames are the caller's;
// the numbers are copied as they are. Any thread.
#pragma once

#include "common/geometry/geometry.h"
#include "common/isosurface/decomposition.h"
#include "palpate/v1/geometry.pb.h"
#include "palpate/v1/render.pb.h"

namespace palpate {

v1::Vector3 ToProto(const Vec3& vector);
v1::Quaternion ToProto(const Eigen::Quaterniond& rotation);
v1::AffineMap ToProto(const AffineMap& map);
v1::DecompositionMethod ToProto(DecompositionMethod method);

Vec3 FromProto(const v1::Vector3& vector);
// Not normalised.
Eigen::Quaterniond FromProto(const v1::Quaternion& rotation);
// Errors: kInvalidArgument when `linear` does not hold nine values.
AffineMap FromProto(const v1::AffineMap& map);
// Errors: kInvalidArgument for a method of another version.
DecompositionMethod FromProto(v1::DecompositionMethod method);

}  // namespace palpate
