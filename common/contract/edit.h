// Written by proto/generate from palpate/v1/edit.proto: change that.
#pragma once

#include <cstdint>
#include <optional>

#include "common/geometry/geometry.h"

namespace palpate {

struct SphereShape {
  Vec3 center = Vec3::Zero();
  double radius = 0.0;
  friend bool operator==(const SphereShape&, const SphereShape&) = default;
};
template <class Visit>
void VisitFields(const SphereShape& value, Visit&& visit) {
  visit("center", value.center);
  visit("radius", value.radius);
}
template <class Visit>
void VisitFields(SphereShape& value, Visit&& visit) {
  visit("center", value.center);
  visit("radius", value.radius);
}

// A box along the frame's axes, including its corners.
struct BoxShape {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Zero();
  friend bool operator==(const BoxShape&, const BoxShape&) = default;
};
template <class Visit>
void VisitFields(const BoxShape& value, Visit&& visit) {
  visit("min", value.min);
  visit("max", value.max);
}
template <class Visit>
void VisitFields(BoxShape& value, Visit&& visit) {
  visit("min", value.min);
  visit("max", value.max);
}

// A stroke: the space that a sphere sweeps on its straight path from one point to the other.
struct CapsuleShape {
  Vec3 from = Vec3::Zero();
  Vec3 to = Vec3::Zero();
  double radius = 0.0;
  friend bool operator==(const CapsuleShape&, const CapsuleShape&) = default;
};
template <class Visit>
void VisitFields(const CapsuleShape& value, Visit&& visit) {
  visit("from", value.from);
  visit("to", value.to);
  visit("radius", value.radius);
}
template <class Visit>
void VisitFields(CapsuleShape& value, Visit&& visit) {
  visit("from", value.from);
  visit("to", value.to);
  visit("radius", value.radius);
}

// Voxels min .. max, both included.
struct IndexBox {
  Vec3i min = Vec3i::Zero();
  Vec3i max = Vec3i::Zero();
  friend bool operator==(const IndexBox&, const IndexBox&) = default;
};
template <class Visit>
void VisitFields(const IndexBox& value, Visit&& visit) {
  visit("min", value.min);
  visit("max", value.max);
}
template <class Visit>
void VisitFields(IndexBox& value, Visit&& visit) {
  visit("min", value.min);
  visit("max", value.max);
}

struct EditVolumeResponse {
  // The volume's revision now. Unchanged if no voxel changed.
  std::uint64_t volume_revision = 0;
  // First tick that used it.
  std::uint64_t applied_tick = 0;
  // Box around the changed voxels; absent if no voxel changed.
  std::optional<IndexBox> changed{};
  std::uint64_t changed_voxels = 0;
  // How often UndoEdit and RedoEdit would work now.
  std::uint32_t undo_steps = 0;
  std::uint32_t redo_steps = 0;
  friend bool operator==(const EditVolumeResponse&, const EditVolumeResponse&) = default;
};
template <class Visit>
void VisitFields(const EditVolumeResponse& value, Visit&& visit) {
  visit("volume_revision", value.volume_revision);
  visit("applied_tick", value.applied_tick);
  visit("changed", value.changed);
  visit("changed_voxels", value.changed_voxels);
  visit("undo_steps", value.undo_steps);
  visit("redo_steps", value.redo_steps);
}
template <class Visit>
void VisitFields(EditVolumeResponse& value, Visit&& visit) {
  visit("volume_revision", value.volume_revision);
  visit("applied_tick", value.applied_tick);
  visit("changed", value.changed);
  visit("changed_voxels", value.changed_voxels);
  visit("undo_steps", value.undo_steps);
  visit("redo_steps", value.redo_steps);
}

}  // namespace palpate
