// Whether a matrix from a vendor's library is a rotation, but for rounding.
//
// Threads: a pure function. Real-time: no allocation.
#pragma once

#include <Eigen/Dense>

namespace palpate {

inline bool IsRotation(const Eigen::Matrix3d& matrix) noexcept {
  // Rounding may leave this much of a rotation's columns.
  constexpr double kTolerance = 0.05;
  if (!matrix.allFinite() || !(matrix.determinant() > 0.0)) return false;
  const Eigen::Matrix3d left = matrix.transpose() * matrix - Eigen::Matrix3d::Identity();
  return left.cwiseAbs().maxCoeff() < kTolerance;
}

}  // namespace palpate
