#include "client/sdk/volume_messages.h"

#include <utility>

#include "client/sdk/setting_messages.h"
#include "common/error/error.h"
#include "common/wire/convert.h"

namespace palpate::client {
namespace {

// An older daemon does not send the map.
AffineMap MapOf(const v1::AffineMap& map) {
  return map.linear_size() == 9 ? palpate::FromProto(map) : AffineMap();
}

v1::RawVoxels RawOf(const RawVoxels& raw) {
  if ((raw.size.array() < 0).any()) {
    throw Error(ErrorKind::kInvalidArgument, "raw voxels of a negative size");
  }
  v1::RawVoxels message;
  message.set_size_x(static_cast<std::uint32_t>(raw.size.x()));
  message.set_size_y(static_cast<std::uint32_t>(raw.size.y()));
  message.set_size_z(static_cast<std::uint32_t>(raw.size.z()));
  message.set_type(static_cast<v1::VoxelType>(raw.type));
  message.set_big_endian(raw.big_endian);
  message.set_offset_bytes(raw.offset_bytes);
  return message;
}

v1::Quaternion RotationOf(const UnalignedQuaternion& rotation) {
  return palpate::ToProto(Eigen::Quaterniond(rotation));
}

}  // namespace

VolumeInfo FromProto(const v1::VolumeDescription& volume) {
  VolumeInfo info;
  info.source = volume.source();
  info.volume_revision = volume.volume_revision();
  info.loaded_revision = volume.loaded_revision();
  info.size = Vec3i(static_cast<int>(volume.size_x()), static_cast<int>(volume.size_y()),
                    static_cast<int>(volume.size_z()));
  info.spacing_mm = palpate::FromProto(volume.spacing_mm());
  info.value_min = volume.value_min();
  info.value_max = volume.value_max();
  info.unit = volume.unit();
  info.original_type = volume.original_type();
  info.is_level_set = volume.is_level_set();
  info.world_from_index = MapOf(volume.world_from_index());
  info.device_from_index = MapOf(volume.device_from_index());
  info.device_mm_per_volume_mm = volume.device_mm_per_volume_mm();
  info.memory_bytes = volume.memory_bytes();
  info.patient_axes = volume.patient_axes();
  info.axes_are_answered = volume.patient_axes_answered();
  info.frames = volume.frames();
  info.unsaved_edits = volume.unsaved_edits();
  info.warnings.assign(volume.warnings().begin(), volume.warnings().end());
  for (const v1::SuggestedIsovalue& suggested : volume.suggested_isovalues()) {
    info.suggested_isovalues.push_back(
        {suggested.name(), suggested.isovalue(), suggested.reason()});
  }
  const v1::ValueHistogram& histogram = volume.histogram();
  info.histogram = {histogram.low(),
                    histogram.high(),
                    {histogram.counts().begin(), histogram.counts().end()},
                    {histogram.peaks().begin(), histogram.peaks().end()}};
  return info;
}

v1::LoadVolumeRequest ToProto(const LoadOptions& options) {
  v1::LoadVolumeRequest request;
  if (options.isovalue && options.normalized_isovalue) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue in data units or over the range, not both");
  }
  if (options.isovalue) request.set_isovalue(*options.isovalue);
  if (options.normalized_isovalue) request.set_normalized_isovalue(*options.normalized_isovalue);
  if (options.spacing_mm) *request.mutable_spacing_mm() = palpate::ToProto(*options.spacing_mm);
  if (options.device_mm_per_volume_mm) {
    request.set_device_mm_per_volume_mm(*options.device_mm_per_volume_mm);
  }
  if (options.raw) *request.mutable_raw() = RawOf(*options.raw);
  if (options.frame) request.set_frame(*options.frame);
  request.set_grid(options.grid);
  request.set_component(options.component);
  request.set_discard_edits(options.discard_edits);
  if (options.settings.expected_revision) {
    throw Error(ErrorKind::kInvalidArgument, "a load cannot expect a revision of the settings");
  }
  v1::UpdateSettingsRequest settings = ToProto(options.settings);
  if (settings.update_mask().paths().empty()) return request;
  *request.mutable_settings() = std::move(*settings.mutable_settings());
  *request.mutable_update_mask() = std::move(*settings.mutable_update_mask());
  return request;
}

Placement FromProto(const v1::Registration& registration, std::uint64_t settings_revision) {
  return {palpate::FromProto(registration.center_mm()),
          UnalignedQuaternion(palpate::FromProto(registration.rotation())),
          registration.device_mm_per_volume_mm(), registration.device_mm_per_voxel(),
          settings_revision};
}

v1::UpdateRegistrationRequest ToProto(const PlacementChange& change) {
  if (change.device_mm_per_volume_mm && change.device_mm_per_voxel) {
    throw Error(ErrorKind::kInvalidArgument, "give the scale per mm or per voxel, not both");
  }
  v1::UpdateRegistrationRequest request;
  request.set_reset(change.reset);
  if (change.center_mm) *request.mutable_center_mm() = palpate::ToProto(*change.center_mm);
  if (change.rotation) *request.mutable_rotation() = RotationOf(*change.rotation);
  if (change.device_mm_per_volume_mm) {
    request.set_device_mm_per_volume_mm(*change.device_mm_per_volume_mm);
  }
  if (change.device_mm_per_voxel) request.set_device_mm_per_voxel(*change.device_mm_per_voxel);
  if (change.translate_mm) {
    *request.mutable_translate_mm() = palpate::ToProto(*change.translate_mm);
  }
  if (change.rotate) *request.mutable_rotate() = RotationOf(*change.rotate);
  if (change.scale_by) request.set_scale_by(*change.scale_by);
  if (change.facing) {
    request.mutable_facing()->set_face(change.facing->face);
    request.mutable_facing()->set_head(change.facing->head);
    if (change.facing->loaded_revision) {
      request.mutable_facing()->set_loaded_revision(*change.facing->loaded_revision);
    }
  }
  if (change.expected_revision) request.set_expected_revision(*change.expected_revision);
  return request;
}

}  // namespace palpate::client
