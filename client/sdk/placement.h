// Where the volume lies in the device's workspace. registration.proto explains the fields.
//
// Frames: W world (mm, LPS), D device (mm, x right, y up, z towards the user).
// Threads: plain values.
#pragma once

#include <array>
#include <string_view>

#include "common/contract/registration.h"

namespace palpate::client {

using palpate::PatientFacing;

using Placement = Registration;
using PlacementNow = GetRegistrationResponse;
// Absent fields change nothing. Of device_mm_per_volume_mm and device_mm_per_voxel at most one may
// be set. What is refused with ABORTED is an ErrorKind::kConflict here.
using PlacementChange = UpdateRegistrationRequest;
using PlacementResult = UpdateRegistrationResponse;

// The directions of PatientFacing.
inline constexpr std::array<const char*, 6> kWorldDirections = {"+x", "-x", "+y", "-y", "+z", "-z"};
// The key under which a guest of palpate-web steers it, beside those of settings. The value is 6
// times the number of the face's direction, plus that of the head's.
inline constexpr std::string_view kFacingKey = "facing";
inline constexpr int kFacings = 36;

}  // namespace palpate::client
