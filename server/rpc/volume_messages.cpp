#include "server/rpc/volume_messages.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "common/wire/convert.h"
#include "server/rpc/render_service.h"

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

}  // namespace

v1::VolumeDescription ToProto(const VolumeState& state) {
  const VolumeMetadata& metadata = state.volume->metadata();
  v1::VolumeDescription out;
  out.set_source(metadata.source);
  out.set_volume_revision(state.volume->revision());
  out.set_size_x(static_cast<std::uint32_t>(metadata.size.x()));
  out.set_size_y(static_cast<std::uint32_t>(metadata.size.y()));
  out.set_size_z(static_cast<std::uint32_t>(metadata.size.z()));
  *out.mutable_spacing_mm() = palpate::ToProto(metadata.spacing_mm);
  out.set_value_min(metadata.value_min);
  out.set_value_max(metadata.value_max);
  out.set_unit(metadata.unit);
  out.set_original_type(metadata.original_type);
  *out.mutable_world_from_index() = palpate::ToProto(metadata.WorldFromIndex());
  *out.mutable_device_from_index() = palpate::ToProto(state.X_DI);
  out.set_device_mm_per_volume_mm(state.registration.device_mm_per_volume_mm);
  out.set_memory_bytes(state.volume->bricks().MemoryBytes());
  out.set_loaded_revision(state.volume->loaded_revision());
  *out.mutable_device_from_world_rotation() = palpate::ToProto(state.registration.R_DW);
  out.set_is_level_set(metadata.is_level_set);
  out.set_unsaved_edits(state.unsaved_edits);
  out.set_patient_axes(state.patient_axes);
  out.set_patient_axes_answered(state.patient_axes_answered());
  out.set_frames(static_cast<std::uint32_t>(metadata.frames));
  for (const std::string& warning : metadata.warnings) out.add_warnings(warning);
  if (state.values->has_padding) {
    out.add_warnings(
        "values below -1024 at the border are padding: for the histogram and the suggested "
        "isovalues they count as -1024");
  }
  if (!state.place_problem.empty()) {
    out.add_warnings("the volume's place or its sides are not kept for its next load: " +
                     state.place_problem);
  }
  for (const auto& [name, isovalue, reason] : state.values->suggested) {
    v1::SuggestedIsovalue& suggested = *out.add_suggested_isovalues();
    suggested.set_name(name);
    suggested.set_isovalue(isovalue);
    suggested.set_reason(reason);
  }
  v1::ValueHistogram& histogram = *out.mutable_histogram();
  histogram.set_low(state.values->low);
  histogram.set_high(state.values->high);
  histogram.mutable_counts()->Assign(state.values->counts.begin(), state.values->counts.end());
  histogram.mutable_peaks()->Assign(state.values->peaks.begin(), state.values->peaks.end());
  return out;
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
