#include "client/sdk/messages.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "common/error/error.h"
#include "common/wire/limits.h"

namespace palpate::client {
namespace {

template <class Request>
void Set(Request& request, const Sphere& sphere) {
  *request.mutable_sphere() = ToProto(sphere);
}
template <class Request>
void Set(Request& request, const Box& box) {
  *request.mutable_box() = ToProto(box);
}
void Set(v1::EditVolumeRequest& request, const Capsule& capsule) {
  *request.mutable_capsule() = ToProto(capsule);
}
void Set(v1::EditVolumeRequest& request, const Block& block) {
  // Checked here, before sending: the daemon cuts off a client whose message it refuses unread.
  if (block.values.size() * sizeof(float) > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge, "a block has at most 3 MiB of values: send it in parts");
  }
  if ((block.min.array() < 0).any() || (block.size.array() < 0).any()) {
    throw Error(ErrorKind::kInvalidArgument, "a block outside of the volume");
  }
  v1::DenseBlock& dense = *request.mutable_block();
  dense.set_min_x(ToCount(block.min.x()));
  dense.set_min_y(ToCount(block.min.y()));
  dense.set_min_z(ToCount(block.min.z()));
  dense.set_size_x(ToCount(block.size.x()));
  dense.set_size_y(ToCount(block.size.y()));
  dense.set_size_z(ToCount(block.size.z()));
  static_assert(std::endian::native == std::endian::little, "as on the wire");
  dense.mutable_values()->assign(reinterpret_cast<const char*>(block.values.data()),
                                 block.values.size() * sizeof(float));
}

v1::RawVoxels RawOf(const RawVoxels& raw) {
  if ((raw.size.array() < 0).any()) {
    throw Error(ErrorKind::kInvalidArgument, "raw voxels of a negative size");
  }
  v1::RawVoxels message;
  message.set_size_x(ToCount(raw.size.x()));
  message.set_size_y(ToCount(raw.size.y()));
  message.set_size_z(ToCount(raw.size.z()));
  message.set_type(static_cast<v1::VoxelType>(raw.type));
  message.set_big_endian(raw.big_endian);
  message.set_offset_bytes(raw.offset_bytes);
  return message;
}

}  // namespace

v1::EditVolumeRequest ToProto(const Edit& edit) {
  v1::EditVolumeRequest request;
  std::visit([&](const auto& shape) { Set(request, shape); }, edit.shape);
  const bool is_index = edit.frame == EditFrame::kIndex || request.has_block();
  request.set_frame(is_index ? v1::EDIT_FRAME_INDEX : static_cast<v1::EditFrame>(edit.frame));
  request.set_operation(static_cast<v1::EditOperation>(edit.operation));
  request.set_value(edit.value);
  request.set_strength(edit.strength);
  request.set_falloff(edit.falloff);
  if (edit.expected_revision) request.set_expected_revision(*edit.expected_revision);
  request.set_stroke(edit.stroke);
  return request;
}

v1::FilterVolumeRequest ToProto(const Filter& filter) {
  v1::FilterVolumeRequest request;
  request.set_kind(static_cast<v1::FilterKind>(filter.kind));
  // A negative width is sent as 0. The daemon refuses both.
  request.set_width(static_cast<std::uint32_t>(std::max(0, filter.width)));
  request.set_iterations(static_cast<std::uint32_t>(std::max(0, filter.iterations)));
  request.set_distance_mm(filter.distance_mm);
  *request.mutable_spacing_mm() = ToProto(filter.spacing_mm);
  if (const auto* sphere = std::get_if<Sphere>(&filter.region)) Set(request, *sphere);
  if (const auto* box = std::get_if<Box>(&filter.region)) Set(request, *box);
  request.set_frame(static_cast<v1::EditFrame>(filter.frame));
  if (filter.expected_revision) request.set_expected_revision(*filter.expected_revision);
  return request;
}

v1::LoadVolumeRequest ToProto(const LoadOptions& options) {
  v1::LoadVolumeRequest request;
  if (options.isovalue && options.normalized_isovalue) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue in data units or over the range, not both");
  }
  if (options.isovalue) request.set_isovalue(*options.isovalue);
  if (options.normalized_isovalue) request.set_normalized_isovalue(*options.normalized_isovalue);
  if (options.spacing_mm) *request.mutable_spacing_mm() = ToProto(*options.spacing_mm);
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

}  // namespace palpate::client
