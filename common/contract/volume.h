// Written by proto/generate from palpate/v1/volume.proto: change that.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate {

// An isovalue that shows something in the volume.
struct SuggestedIsovalue {
  // "otsu"; for Hounsfield units also "bone" and "skin"; "surface" of a level set or a built-in
  // shape.
  std::string name{};
  // Data units.
  double isovalue = 0.0;
  // A few words for people.
  std::string reason{};
  friend bool operator==(const SuggestedIsovalue&, const SuggestedIsovalue&) = default;
};
template <class Visit>
void VisitFields(const SuggestedIsovalue& value, Visit&& visit) {
  visit("name", value.name);
  visit("isovalue", value.isovalue);
  visit("reason", value.reason);
}
template <class Visit>
void VisitFields(SuggestedIsovalue& value, Visit&& visit) {
  visit("name", value.name);
  visit("isovalue", value.isovalue);
  visit("reason", value.reason);
}

// How often values occur, in data units. Of volumes above 2^25 voxels, a part is counted.
struct ValueHistogram {
  // The bins are equal, at most 256, and cover low to high. Values outside count in the first
  // and the last bin.
  double low = 0.0;
  double high = 0.0;
  std::vector<std::uint64_t> counts{};
  // Where the counts have peaks, ascending, without the background.
  std::vector<double> peaks{};
  friend bool operator==(const ValueHistogram&, const ValueHistogram&) = default;
};
template <class Visit>
void VisitFields(const ValueHistogram& value, Visit&& visit) {
  visit("low", value.low);
  visit("high", value.high);
  visit("counts", value.counts);
  visit("peaks", value.peaks);
}
template <class Visit>
void VisitFields(ValueHistogram& value, Visit&& visit) {
  visit("low", value.low);
  visit("high", value.high);
  visit("counts", value.counts);
  visit("peaks", value.peaks);
}

struct SaveVolumeResult {
  // The revision that was written.
  std::uint64_t volume_revision = 0;
  std::uint64_t size_bytes = 0;
  friend bool operator==(const SaveVolumeResult&, const SaveVolumeResult&) = default;
};
template <class Visit>
void VisitFields(const SaveVolumeResult& value, Visit&& visit) {
  visit("volume_revision", value.volume_revision);
  visit("size_bytes", value.size_bytes);
}
template <class Visit>
void VisitFields(SaveVolumeResult& value, Visit&& visit) {
  visit("volume_revision", value.volume_revision);
  visit("size_bytes", value.size_bytes);
}

struct VolumeDescription {
  // Path or builtin name that it was loaded from, or "upload:NAME".
  std::string source{};
  std::uint64_t volume_revision = 0;
  // Voxels along x, y, z.
  Vec3i size = Vec3i::Zero();
  Vec3 spacing_mm = Vec3::Zero();
  // Least and greatest value at load, in data units.
  double value_min = 0.0;
  double value_max = 0.0;
  // Unit of the values as stated in the file ("HU"); empty if not stated.
  std::string unit{};
  // Scalar type of the original file, such as "uint8".
  std::string original_type{};
  // True for signed distances from a surface at 0, negative inside, from a .vdb file.
  bool is_level_set = false;
  // Voxel index to world: mm; LPS if the file states an orientation.
  AffineMap world_from_index{};
  // Voxel index to device frame: mm.
  AffineMap device_from_index{};
  // Millimetres of device motion per millimetre of the volume.
  double device_mm_per_volume_mm = 0.0;
  // As in VolumePlacement, both.
  std::string patient_axes{};
  bool patient_axes_answered = false;
  std::uint64_t memory_bytes = 0;
  // Edits, undos and filters since the voxels were loaded or saved; a stroke of the stylus
  // counts once. 0 if the voxels are the same again. A download does not count as saved. Of a
  // series: since it was loaded.
  std::uint64_t unsaved_edits = 0;
  // Assumptions and omissions of this volume's import, for users: voxels that are not numbers,
  // a missing spacing, slices with uneven spacing. For a series: the first frame's. One line
  // each, at most 16 lines of at most 300 bytes. If there are more, the last line counts the
  // rest. One more line each if the volume's place, or the settings, cannot be stored.
  std::vector<std::string> warnings{};
  // Isovalues that show something in the volume as loaded. A load that names no isovalue starts
  // at the first.
  std::vector<SuggestedIsovalue> suggested_isovalues{};
  // Volume revision at which this volume was loaded. Later revisions are its edits and frames.
  std::uint64_t loaded_revision = 0;
  // Number of frames in the source file; this volume is one of them.
  std::uint32_t frames = 0;
  // Rotation from W to the device frame.
  UnalignedQuaternion device_from_world_rotation = UnalignedQuaternion::Identity();
  // Of the volume as loaded.
  ValueHistogram histogram{};
  // `source` without its folders.
  std::string name{};
  // Type of the voxels, and the level and width of the window that the file proposes; width 0:
  // none.
  VoxelType voxel_type = VoxelType::kUnknown;
  double window_level = 0.0;
  double window_width = 0.0;
  // As in VolumePlacement.
  bool replayed = false;
  friend bool operator==(const VolumeDescription&, const VolumeDescription&) = default;
};
template <class Visit>
void VisitFields(const VolumeDescription& value, Visit&& visit) {
  visit("source", value.source);
  visit("volume_revision", value.volume_revision);
  visit("size", value.size);
  visit("spacing_mm", value.spacing_mm);
  visit("value_min", value.value_min);
  visit("value_max", value.value_max);
  visit("unit", value.unit);
  visit("original_type", value.original_type);
  visit("is_level_set", value.is_level_set);
  visit("world_from_index", value.world_from_index);
  visit("device_from_index", value.device_from_index);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("patient_axes", value.patient_axes);
  visit("patient_axes_answered", value.patient_axes_answered);
  visit("memory_bytes", value.memory_bytes);
  visit("unsaved_edits", value.unsaved_edits);
  visit("warnings", value.warnings);
  visit("suggested_isovalues", value.suggested_isovalues);
  visit("loaded_revision", value.loaded_revision);
  visit("frames", value.frames);
  visit("device_from_world_rotation", value.device_from_world_rotation);
  visit("histogram", value.histogram);
  visit("name", value.name);
  visit("voxel_type", value.voxel_type);
  visit("window_level", value.window_level);
  visit("window_width", value.window_width);
  visit("replayed", value.replayed);
}
template <class Visit>
void VisitFields(VolumeDescription& value, Visit&& visit) {
  visit("source", value.source);
  visit("volume_revision", value.volume_revision);
  visit("size", value.size);
  visit("spacing_mm", value.spacing_mm);
  visit("value_min", value.value_min);
  visit("value_max", value.value_max);
  visit("unit", value.unit);
  visit("original_type", value.original_type);
  visit("is_level_set", value.is_level_set);
  visit("world_from_index", value.world_from_index);
  visit("device_from_index", value.device_from_index);
  visit("device_mm_per_volume_mm", value.device_mm_per_volume_mm);
  visit("patient_axes", value.patient_axes);
  visit("patient_axes_answered", value.patient_axes_answered);
  visit("memory_bytes", value.memory_bytes);
  visit("unsaved_edits", value.unsaved_edits);
  visit("warnings", value.warnings);
  visit("suggested_isovalues", value.suggested_isovalues);
  visit("loaded_revision", value.loaded_revision);
  visit("frames", value.frames);
  visit("device_from_world_rotation", value.device_from_world_rotation);
  visit("histogram", value.histogram);
  visit("name", value.name);
  visit("voxel_type", value.voxel_type);
  visit("window_level", value.window_level);
  visit("window_width", value.window_width);
  visit("replayed", value.replayed);
}

struct LoadVolumeResult {
  VolumeDescription volume{};
  // First tick that used the new volume.
  std::uint64_t applied_tick = 0;
  std::uint64_t settings_revision = 0;
  // That the volume starts at, in data units.
  double isovalue = 0.0;
  friend bool operator==(const LoadVolumeResult&, const LoadVolumeResult&) = default;
};
template <class Visit>
void VisitFields(const LoadVolumeResult& value, Visit&& visit) {
  visit("volume", value.volume);
  visit("applied_tick", value.applied_tick);
  visit("settings_revision", value.settings_revision);
  visit("isovalue", value.isovalue);
}
template <class Visit>
void VisitFields(LoadVolumeResult& value, Visit&& visit) {
  visit("volume", value.volume);
  visit("applied_tick", value.applied_tick);
  visit("settings_revision", value.settings_revision);
  visit("isovalue", value.isovalue);
}

}  // namespace palpate
