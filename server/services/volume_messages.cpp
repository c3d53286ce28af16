#include "server/services/volume_messages.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>

#include "common/contract/enumerations.h"
#include "common/contract/volume.h"
#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/values.h"
#include "common/wire/volume_message.h"
#include "server/services/render_service.h"

namespace palpate {
namespace {

RawVoxels RawFromProto(const v1::RawVoxels& raw) {
  constexpr std::uint64_t kMostOffset = std::numeric_limits<std::int64_t>::max();
  if (raw.offset_bytes() > kMostOffset) {
    Refuse("raw.offset_bytes is beyond any file");
  }
  const auto type = EnumeratorOf<VoxelType>(raw.type());
  if (type == VoxelType::kUnknown) {
    Refuse("raw.type is missing or unknown: say which type the voxels have");
  }
  return {.size = {raw.size_x(), raw.size_y(), raw.size_z()},
          .type = std::string(NameOf(type)),
          .big_endian = raw.big_endian(),
          .offset_bytes = static_cast<std::int64_t>(raw.offset_bytes())};
}

// Without the folders, which not everybody needs to know.
std::string NameOfSource(std::filesystem::path source) {
  if (!source.has_filename()) source = source.parent_path();
  return source.filename().string();
}

}  // namespace

v1::VolumeDescription ToProto(const VolumeState& state) {
  const VolumeMetadata& metadata = state.volume->metadata();
  const VolumeValues& values = *state.values;
  VolumeDescription out = {
      .source = metadata.source,
      .volume_revision = state.volume->revision(),
      .size = metadata.size,
      .spacing_mm = metadata.spacing_mm,
      .value_min = metadata.value_min,
      .value_max = metadata.value_max,
      .unit = metadata.unit,
      .original_type = metadata.original_type,
      .is_level_set = metadata.is_level_set,
      .world_from_index = metadata.WorldFromIndex(),
      .device_from_index = state.X_DI,
      .device_mm_per_volume_mm = state.registration.device_mm_per_volume_mm,
      .patient_axes = state.patient_axes,
      .patient_axes_answered = state.patient_axes_answered(),
      .memory_bytes = state.volume->bricks().MemoryBytes(),
      .unsaved_edits = state.unsaved_edits,
      .warnings = metadata.warnings,
      .suggested_isovalues = values.suggested,
      .loaded_revision = state.volume->loaded_revision(),
      .frames = static_cast<std::uint32_t>(metadata.frames),
      .device_from_world_rotation = UnalignedQuaternion(state.registration.R_DW),
      .histogram = values.histogram,
      .name = NameOfSource(metadata.source),
      .voxel_type = EnumeratorOf<VoxelType>(VoxelTypeOf(state.volume->bricks().made_type())),
      .window_level = metadata.window_level,
      .window_width = metadata.window_width,
      .replayed = state.replayed};
  if (values.has_padding) {
    out.warnings.push_back(
        "values below -1024 at the border are padding: for the histogram and the suggested "
        "isovalues they count as -1024");
  }
  if (!state.place_problem.empty()) {
    out.warnings.push_back("the volume's place or its sides are not kept for its next load: " +
                           state.place_problem);
  }
  if (!state.settings_problem.empty()) {
    out.warnings.push_back("the settings are not kept for palpated's next start: " +
                           state.settings_problem);
  }
  return palpate::ToProto(out);
}

namespace {

// The importer gets these names as arguments.
std::string CheckedName(const std::string& name, const char* field) {
  constexpr std::size_t kLongest = 256;
  const bool is_text = std::none_of(name.begin(), name.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte < 0x20 || byte == 0x7f;
  });
  if (name.size() <= kLongest && is_text) return name;
  Refuse(std::string("`") + field + "` must be at most " + std::to_string(kLongest) +
         " bytes without control characters");
}

}  // namespace

LoadRequest FromProto(const v1::LoadVolumeRequest& request) {
  LoadRequest load;
  load.source = request.source();
  if (request.has_isovalue()) load.isovalue = request.isovalue();
  if (request.has_normalized_isovalue()) load.normalized_isovalue = request.normalized_isovalue();
  if (request.has_spacing_mm()) load.spacing_mm = palpate::FromProto(request.spacing_mm());
  if (request.has_device_mm_per_volume_mm()) {
    load.device_mm_per_volume_mm = request.device_mm_per_volume_mm();
  }
  if (request.has_raw()) load.raw = RawFromProto(request.raw());
  if (request.has_frame()) load.frame = request.frame();
  load.grid = CheckedName(request.grid(), "grid");
  load.component = CheckedName(request.component(), "component");
  load.discards_edits = request.discard_edits();
  return load;
}

SettingsUpdate SettingsOf(const v1::LoadVolumeRequest& request) {
  if (request.has_settings() && request.update_mask().paths().empty()) {
    Refuse("update_mask is empty: name the settings to change with the load");
  }
  return FromProto(request.settings(), request.update_mask());
}

}  // namespace palpate
