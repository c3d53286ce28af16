// A vendor's library, loaded at run time. A build needs neither it nor its headers.
//
// Threads: one. Not real-time: it reads files and runs the library's start-up code.
// Ownership: the library stays in memory until the process ends, because its threads may outlive a
// device.
// Errors: Error (kNotFound) if the library or one of its functions is missing.
#pragma once

#include <Eigen/Dense>
#include <string>

namespace palpate {

class VendorLibrary {
 public:
  // path: a file, or a name for which the loader searches. what: such as "the vendor's HD library".
  // advice: how to get it.
  VendorLibrary(const std::string& path, std::string what, std::string advice);

  template <class Function>
  void Resolve(const char* name, Function& function) const {
    function = reinterpret_cast<Function>(Find(name));
  }

 private:
  void* Find(const char* name) const;

  const std::string path_;
  const std::string what_;
  const std::string advice_;
  void* library_ = nullptr;
};

// Whether a matrix from a vendor's library is a rotation, but for rounding.
//
// Threads: a pure function. Real-time: no allocation.
inline bool IsRotation(const Eigen::Matrix3d& matrix) noexcept {
  // Rounding may leave this much of a rotation's columns.
  constexpr double kTolerance = 0.05;
  if (!matrix.allFinite() || !(matrix.determinant() > 0.0)) return false;
  const Eigen::Matrix3d left = matrix.transpose() * matrix - Eigen::Matrix3d::Identity();
  return left.cwiseAbs().maxCoeff() < kTolerance;
}

}  // namespace palpate
