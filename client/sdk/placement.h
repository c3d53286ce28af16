// Where the volume lies in the device's workspace. Fields mean what registration.proto says.
//
// Frames: W world (mm, LPS), D device (mm, x right, y up, z towards the user).
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>

#include "client/sdk/pose.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

struct Placement {
  Vec3 center_mm = Vec3::Zero();  // D
  // Turns the axes of W to those of D.
  UnalignedQuaternion rotation = UnalignedQuaternion::Identity();
  double device_mm_per_volume_mm = 0.0;
  double device_mm_per_voxel = 0.0;  // for the shortest edge of a voxel
  std::uint64_t settings_revision = 0;
};

// Applied in this order: `reset`, absolute values, relative values. Absent fields change nothing.
struct PlacementChange {
  bool reset = false;  // into the middle of the workspace, fitted, without a rotation
  std::optional<Vec3> center_mm{};
  std::optional<UnalignedQuaternion> rotation{};
  // Set at most one of the two.
  std::optional<double> device_mm_per_volume_mm{};
  std::optional<double> device_mm_per_voxel{};
  // In the axes of D. Rotation and scale are about the volume's centre.
  std::optional<Vec3> translate_mm{};
  std::optional<UnalignedQuaternion> rotate{};
  std::optional<double> scale_by{};
  // Fails with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

struct PlacementResult {
  Placement placement;
  std::uint64_t applied_tick = 0;  // first tick that used it
};

}  // namespace palpate::client
