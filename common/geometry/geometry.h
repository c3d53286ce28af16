// Vectors and maps shared by every part.
//
// Frames (suffixes of names): D device (mm, x right, y up, z to the user),
// W world (mm, LPS as in DICOM), I voxel index. `p_DH` is H's position in D;
// `X_DI` maps index coordinates to device coordinates.
//
// Threads: plain values. Real-time: no allocation, no locks.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace palpate {

using Vec3 = Eigen::Vector3d;
using Vec3i = Eigen::Vector3i;
using Mat3 = Eigen::Matrix3d;
// The alignment of Eigen::Quaterniond depends on the compiler's flags, and a program and a library
// that it uses may have different ones.
using UnalignedQuaternion = Eigen::Quaternion<double, Eigen::DontAlign>;

// q = linear * p + translation.
struct AffineMap {
  Mat3 linear = Mat3::Identity();
  Vec3 translation = Vec3::Zero();

  Vec3 Apply(const Vec3& p) const { return linear * p + translation; }

  // Requires an invertible linear part.
  AffineMap Inverse() const {
    AffineMap inverse;
    inverse.linear = linear.inverse();
    inverse.translation = -(inverse.linear * translation);
    return inverse;
  }

  // True if all numbers are equal.
  bool operator==(const AffineMap&) const = default;

  // (a * b)(p) = a(b(p)).
  friend AffineMap operator*(const AffineMap& a, const AffineMap& b) {
    return {a.linear * b.linear, a.linear * b.translation + a.translation};
  }
};

}  // namespace palpate
