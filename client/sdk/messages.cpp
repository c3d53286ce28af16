#include "client/sdk/messages.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <bit>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "common/error/error.h"
#include "common/wire/limits.h"
#include "common/wire/values.h"

namespace palpate::client {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Reflection;

// The fields have the settings' keys: both are generated from the same list.
const FieldDescriptor* FieldOf(const Setting& setting) {
  return v1::RenderSettings::descriptor()->FindFieldByName(std::string(setting.key));
}

// Copies a field into a Settings. Returns false for a choice of a later version.
struct Read {
  const v1::RenderSettings& from;
  const Reflection& fields;
  const FieldDescriptor* field;
  Settings& to;

  bool operator()(const NumberSetting& number) const {
    to.*number.member = fields.GetDouble(from, field);
    return true;
  }
  bool operator()(const FlagSetting& flag) const {
    to.*flag.member = fields.GetBool(from, field);
    return true;
  }
  bool operator()(const ChoiceSetting& choice) const {
    const int number = fields.GetEnumValue(from, field);
    if (number < 1 || static_cast<std::size_t>(number) > choice.words.size()) return false;
    choice.set(to, static_cast<std::size_t>(number) - 1);
    return true;
  }
};

// Copies a value of an update into a field. Returns false if the update has no value.
struct Write {
  const SettingsUpdate& from;
  const Reflection& fields;
  const FieldDescriptor* field;
  v1::RenderSettings& to;

  bool operator()(const NumberSetting& number) const {
    const std::optional<double>& value = from.*number.update;
    if (value) fields.SetDouble(&to, field, *value);
    return value.has_value();
  }
  bool operator()(const FlagSetting& flag) const {
    const std::optional<bool>& value = from.*flag.update;
    if (value) fields.SetBool(&to, field, *value);
    return value.has_value();
  }
  bool operator()(const ChoiceSetting& choice) const {
    const std::optional<std::size_t> place = choice.updated(from);
    if (place) fields.SetEnumValue(&to, field, static_cast<int>(*place) + 1);
    return place.has_value();
  }
};

}  // namespace

Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision,
                   const v1::BallState& ball, bool replayed) {
  Settings result;
  result.revision = revision;
  result.replayed = replayed;
  const Reflection& fields = *settings.GetReflection();
  for (std::size_t n = 0; n < kSettings.size(); ++n) {
    const FieldDescriptor* field = FieldOf(kSettings[n]);
    const bool is_known = fields.HasField(settings, field) &&
                          std::visit(Read{settings, fields, field, result}, kSettings[n].kind);
    result.unknown.set(n, !is_known);
  }
  result.layers = palpate::FromProto(settings.layers());
  result.tool = palpate::FromProto(settings.tool());
  result.ball = palpate::FromProto(ball);
  return result;
}

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update) {
  v1::UpdateSettingsRequest request;
  v1::RenderSettings& settings = *request.mutable_settings();
  const Reflection& fields = *settings.GetReflection();
  for (const Setting& setting : kSettings) {
    const bool is_changed =
        std::visit(Write{update, fields, FieldOf(setting), settings}, setting.kind);
    if (is_changed) request.mutable_update_mask()->add_paths(std::string(setting.key));
  }
  if (update.layers) {
    *settings.mutable_layers() = palpate::ToProto(*update.layers);
    request.mutable_update_mask()->add_paths("layers");
  }
  if (update.tool) {
    *settings.mutable_tool() = palpate::ToProto(*update.tool);
    request.mutable_update_mask()->add_paths("tool");
  }
  if (update.expected_revision) request.set_expected_revision(*update.expected_revision);
  return request;
}

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
