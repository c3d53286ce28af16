// Written by proto/generate from palpate/v1/registration.proto: change that.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

// Where the volume lies: its centre, rotation and scale. Rotation and scaling leave the centre
// in place.
struct Registration {
  // In the device frame: mm, x right, y up, z towards the user.
  Vec3 center_mm = Vec3::Zero();
  // Rotates the world's axes to the device's axes.
  UnalignedQuaternion rotation = UnalignedQuaternion::Identity();
  // Millimetres of device motion per millimetre of the volume.
  double device_mm_per_volume_mm = 0.0;
  // Shortest edge of a voxel in the device frame; its inverse is "1 mm = n cells".
  double device_mm_per_voxel = 0.0;
  friend bool operator==(const Registration&, const Registration&) = default;
};
template <class Visit>
void VisitFields(const Registration& value, Visit&& visit) {
  visit("center_mm", value.center_mm);
  visit("rotation", value.rotation);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("device_mm_per_voxel", value.device_mm_per_voxel);
}
template <class Visit>
void VisitFields(Registration& value, Visit&& visit) {
  visit("center_mm", value.center_mm);
  visit("rotation", value.rotation);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("device_mm_per_voxel", value.device_mm_per_voxel);
}

// Two directions of the world (LPS where the file states an orientation), not along the same
// axis. The patient's left follows from them if the file is not mirrored.
struct PatientFacing {
  // Where the face (anterior) points: "+x", "-x", "+y", "-y", "+z" or "-z".
  std::string face{};
  // Where the head (superior) points, in the same words.
  std::string head{};
  // VolumeDescription.loaded_revision of the volume that was looked at: refused with ABORTED if
  // another one has been loaded meanwhile. Absent: of the present volume, whichever it is.
  std::optional<std::uint64_t> loaded_revision{};
  friend bool operator==(const PatientFacing&, const PatientFacing&) = default;
};
template <class Visit>
void VisitFields(const PatientFacing& value, Visit&& visit) {
  visit("face", value.face);
  visit("head", value.head);
  visit("loaded_revision", value.loaded_revision);
}
template <class Visit>
void VisitFields(PatientFacing& value, Visit&& visit) {
  visit("face", value.face);
  visit("head", value.head);
  visit("loaded_revision", value.loaded_revision);
}

struct GetRegistrationResponse {
  Registration registration{};
  std::uint64_t settings_revision = 0;
  // As in VolumePlacement.
  bool replayed = false;
  friend bool operator==(const GetRegistrationResponse&, const GetRegistrationResponse&) = default;
};
template <class Visit>
void VisitFields(const GetRegistrationResponse& value, Visit&& visit) {
  visit("registration", value.registration);
  visit("settings_revision", value.settings_revision);
  visit("replayed", value.replayed);
}
template <class Visit>
void VisitFields(GetRegistrationResponse& value, Visit&& visit) {
  visit("registration", value.registration);
  visit("settings_revision", value.settings_revision);
  visit("replayed", value.replayed);
}

struct UpdateRegistrationRequest {
  // Applied first: the volume in the middle of the workspace, fitted, with axes along the
  // device's.
  bool reset = false;
  std::optional<Vec3> center_mm{};
  std::optional<UnalignedQuaternion> rotation{};
  std::optional<double> device_mm_per_volume_mm{};
  std::optional<double> device_mm_per_voxel{};
  // Applied last, in the device's axes. `rotate` turns about the volume's centre.
  std::optional<Vec3> translate_mm{};
  std::optional<UnalignedQuaternion> rotate{};
  std::optional<double> scale_by{};
  // Refuse with ABORTED unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
  // Where the patient faces, for a file that states no orientation. Moves nothing. The daemon
  // keeps the answer for these voxels: a copy of the file under another name gets it, too.
  std::optional<PatientFacing> facing{};
  friend bool operator==(const UpdateRegistrationRequest&, const UpdateRegistrationRequest&) = default;
};
template <class Visit>
void VisitFields(const UpdateRegistrationRequest& value, Visit&& visit) {
  visit("reset", value.reset);
  visit("center_mm", value.center_mm);
  visit("rotation", value.rotation);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("device_mm_per_voxel", value.device_mm_per_voxel);
  visit("translate_mm", value.translate_mm);
  visit("rotate", value.rotate);
  visit("scale_by", value.scale_by);
  visit("expected_revision", value.expected_revision);
  visit("facing", value.facing);
}
template <class Visit>
void VisitFields(UpdateRegistrationRequest& value, Visit&& visit) {
  visit("reset", value.reset);
  visit("center_mm", value.center_mm);
  visit("rotation", value.rotation);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("device_mm_per_voxel", value.device_mm_per_voxel);
  visit("translate_mm", value.translate_mm);
  visit("rotate", value.rotate);
  visit("scale_by", value.scale_by);
  visit("expected_revision", value.expected_revision);
  visit("facing", value.facing);
}

struct UpdateRegistrationResponse {
  Registration registration{};
  std::uint64_t settings_revision = 0;
  std::uint64_t applied_tick = 0;
  // As in UpdateSettingsResponse, for the place or the answer.
  std::string not_kept{};
  friend bool operator==(const UpdateRegistrationResponse&, const UpdateRegistrationResponse&) = default;
};
template <class Visit>
void VisitFields(const UpdateRegistrationResponse& value, Visit&& visit) {
  visit("registration", value.registration);
  visit("settings_revision", value.settings_revision);
  visit("applied_tick", value.applied_tick);
  visit("not_kept", value.not_kept);
}
template <class Visit>
void VisitFields(UpdateRegistrationResponse& value, Visit&& visit) {
  visit("registration", value.registration);
  visit("settings_revision", value.settings_revision);
  visit("applied_tick", value.applied_tick);
  visit("not_kept", value.not_kept);
}

}  // namespace palpate
