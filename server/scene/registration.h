// Where a volume lies in the device's workspace.
//
// Frames: D device (mm), W world (mm), I voxel index. X_DW is a similarity: a
// rotation, one scale and a translation.
// Threads: pure. Errors: Error (kInvalidArgument); the registration given stays.
#pragma once

#include <optional>

#include "common/geometry/geometry.h"
#include "server/device/haptic_device.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

// Made by MakeRegistration, which keeps its parts equal to each other.
struct Registration {
  double device_mm_per_volume_mm = 1.0;
  AffineMap X_DW;
  // The parts that X_DW is made of: kept beside it, so that they are read back as
  // they were given, and a million small moves leave it a similarity.
  Vec3 p_DCenter_mm = Vec3::Zero();  // of the volume
  Eigen::Quaterniond R_DW = Eigen::Quaterniond::Identity();
};

// Share of the workspace that a fitted volume fills, so that the stylus can go
// round it.
inline constexpr double kWorkspaceFill = 0.9;
// Voxels of other sizes cannot be felt; their arithmetic would overflow one day.
inline constexpr double kLeastVoxelMm = 1e-6;
inline constexpr double kGreatestVoxelMm = 1e6;
// Greatest distance of the volume's centre from the device's origin, along each axis.
inline constexpr double kFarthestCenterMm = 1e6;

// What to change of a registration, in this order. What is absent stays.
struct RegistrationUpdate {
  bool reset = false;  // as FitToWorkspace has it
  std::optional<Vec3> p_DCenter_mm{};
  std::optional<Eigen::Quaterniond> R_DW{};  // unit, up to rounding
  // At most one of the two.
  std::optional<double> device_mm_per_volume_mm{};
  std::optional<double> device_mm_per_voxel{};  // of the shortest edge
  // On top of these, in the device's axes, about the volume's centre.
  std::optional<Vec3> translate_D_mm{};
  std::optional<Eigen::Quaterniond> rotate_D{};  // unit, up to rounding
  std::optional<double> scale_by{};
};

// The middle of the lattice.
Vec3 VolumeCenterMm(const VolumeMetadata& volume);

// Shortest edge of a voxel in D.
double DeviceMmPerVoxel(const Registration& registration, const VolumeMetadata& volume);

// The volume with its centre at p_DCenter_mm, turned by R_DW (normalised here) and
// scaled.
Registration MakeRegistration(const VolumeMetadata& volume, const Vec3& p_DCenter_mm,
                              const Eigen::Quaterniond& R_DW, double device_mm_per_volume_mm);

// The middle of the volume in the middle of the workspace, axes of W along those
// of D, uniformly scaled so that its bounding box fits, or by the given scale.
Registration FitToWorkspace(const VolumeMetadata& volume, const DeviceSpec& device,
                            std::optional<double> device_mm_per_volume_mm);

Registration Apply(const RegistrationUpdate& update, const VolumeMetadata& volume,
                   const DeviceSpec& device, const Registration& current);

}  // namespace palpate
