// Describes where a volume lies in the device's workspace.
//
// Frames: D device (mm), W world (mm), I voxel index. X_DW is a similarity: a rotation, one scale
// and a translation.
// Threads: pure functions. Errors: Error (kInvalidArgument).
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "common/contract/device.h"
#include "common/contract/registration.h"
#include "common/geometry/geometry.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Made by MakeVolumePlace, which keeps X_DW equal to its parts.
struct VolumePlace {
  double device_mm_per_volume_mm = 1.0;
  AffineMap X_DW;
  // The parts of X_DW. They are kept so that clients read back the values that they gave, and so
  // that X_DW stays a similarity after a million small moves.
  Vec3 p_DCenter_mm = Vec3::Zero();  // of the volume
  Eigen::Quaterniond R_DW = Eigen::Quaterniond::Identity();
};

// Share of the workspace that a fitted volume fills. The rest lets the stylus go round the volume.
inline constexpr double kWorkspaceFill = 0.9;
// Voxels of other sizes cannot be felt, and their arithmetic could overflow.
inline constexpr double kLeastVoxelMm = 1e-6;
inline constexpr double kGreatestVoxelMm = 1e6;
// Greatest distance of the volume's centre from the device's origin, along each axis.
inline constexpr double kFarthestCenterMm = 1e6;

// The middle of the lattice.
Vec3 VolumeCenterMm(const VolumeMetadata& volume);

// The shortest edge of a voxel in D.
double DeviceMmPerVoxel(const VolumePlace& registration, const VolumeMetadata& volume);

// Puts the volume's centre at p_DCenter_mm. Rotates the volume by R_DW (normalised here) and scales
// it.
VolumePlace MakeVolumePlace(const VolumeMetadata& volume, const Vec3& p_DCenter_mm,
                            const Eigen::Quaterniond& R_DW, double device_mm_per_volume_mm);

// Puts the middle of the volume in the middle of the workspace, with W's axes along D's. Without a
// given scale, scales the volume uniformly so that its bounding box fits.
VolumePlace FitToWorkspace(const VolumeMetadata& volume, const DeviceDescription& device,
                           std::optional<double> device_mm_per_volume_mm);

// Errors: also for rotations that are no unit quaternions, up to rounding, and for both scales.
VolumePlace Apply(const UpdateRegistrationRequest& update, const VolumeMetadata& volume,
                  const DeviceDescription& device, const VolumePlace& current);

// Where a patient faces in W, as people answer it for a file that states no orientation.
//
// Frame: W world (mm). Threads: pure functions.

// Returns axes as in VolumeMetadata::patient_axes. Left follows from the two directions: the file
// is taken as not mirrored. Throws Error (kInvalidArgument) for other words, or both along one
// axis.
std::string PatientAxesOf(const PatientFacing& facing);

// True for what PatientAxesOf can return.
bool IsAnsweredAxes(std::string_view axes);

}  // namespace palpate
