// Where the volume lies in the device's workspace. Fields mean what registration.proto says.
//
// Frames: W world (mm, LPS), D device (mm, x right, y up, z towards the user).
// Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

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

// Where the patient faces: directions of W, each one of kWorldDirections.
struct PatientFacing {
  std::string face;  // anterior
  std::string head;  // superior
  // Of the volume that was looked at: another one in its place is a conflict.
  std::optional<std::uint64_t> loaded_revision{};
};
inline constexpr std::array<const char*, 6> kWorldDirections = {"+x", "-x", "+y", "-y", "+z", "-z"};
// The key under which a guest of palpate-web steers it, beside those of settings. The value is 6
// times the number of the face's direction, plus that of the head's.
inline constexpr std::string_view kFacingKey = "facing";
inline constexpr int kFacings = 36;

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
  // An answer, for a file that states no orientation. Moves nothing.
  std::optional<PatientFacing> facing{};
  // Fails with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

struct PlacementResult {
  Placement placement;
  std::uint64_t applied_tick = 0;  // first tick that used it
};

}  // namespace palpate::client
