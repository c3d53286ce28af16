// Written by proto/generate from palpate/v1/volume_stream.proto: change that.
#pragma once

#include <cstdint>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

struct VolumeRevision {
  // A random number, new at each start of the daemon.
  std::uint64_t daemon_id = 0;
  std::uint64_t volume_revision = 0;
  friend bool operator==(const VolumeRevision&, const VolumeRevision&) = default;
};
template <class Visit>
void VisitFields(const VolumeRevision& value, Visit&& visit) {
  visit("daemon_id", value.daemon_id);
  visit("volume_revision", value.volume_revision);
}
template <class Visit>
void VisitFields(VolumeRevision& value, Visit&& visit) {
  visit("daemon_id", value.daemon_id);
  visit("volume_revision", value.volume_revision);
}

// Means of blocks of 4³ voxels, to show a preview while the bricks come.
struct VolumeOverview {
  // ceil(size / 4) blocks along each axis.
  Vec3i size = Vec3i::Zero();
  // Block (i, j, k) is float (i·size_y + j)·size_z + k. This message holds blocks from
  // first_block on, as zstd of little-endian float32.
  std::uint64_t first_block = 0;
  std::string zstd_values{};
  friend bool operator==(const VolumeOverview&, const VolumeOverview&) = default;
};
template <class Visit>
void VisitFields(const VolumeOverview& value, Visit&& visit) {
  visit("size", value.size);
  visit("first_block", value.first_block);
  visit("zstd_values", value.zstd_values);
}
template <class Visit>
void VisitFields(VolumeOverview& value, Visit&& visit) {
  visit("size", value.size);
  visit("first_block", value.first_block);
  visit("zstd_values", value.zstd_values);
}

// How the volume lies. Sent after the lattice, after each move, and after each answer to where
// the patient faces.
struct VolumePlacement {
  // Voxel index to device frame: mm.
  AffineMap device_from_index{};
  std::uint64_t settings_revision = 0;
  // Where +x, +y and +z of the world (world_from_index) point in the patient: three of L, R, P,
  // A, S and I. "LPS" if the file states an orientation; otherwise what somebody answered, such
  // as "RAS". Empty: unknown. Clients then show no sides of a patient.
  std::string patient_axes{};
  // True if patient_axes was answered (UpdateRegistration), not stated by the file.
  bool patient_axes_answered = false;
  // A recording is replayed: the place and the voxels are the recorded ones.
  bool replayed = false;
  friend bool operator==(const VolumePlacement&, const VolumePlacement&) = default;
};
template <class Visit>
void VisitFields(const VolumePlacement& value, Visit&& visit) {
  visit("device_from_index", value.device_from_index);
  visit("settings_revision", value.settings_revision);
  visit("patient_axes", value.patient_axes);
  visit("patient_axes_answered", value.patient_axes_answered);
  visit("replayed", value.replayed);
}
template <class Visit>
void VisitFields(VolumePlacement& value, Visit&& visit) {
  visit("device_from_index", value.device_from_index);
  visit("settings_revision", value.settings_revision);
  visit("patient_axes", value.patient_axes);
  visit("patient_axes_answered", value.patient_axes_answered);
  visit("replayed", value.replayed);
}

}  // namespace palpate
