// The daemon's volume, and how to load another one. volume.proto explains the fields.
//
// Frames: I voxel indices, W world (mm, LPS as in DICOM), D device (mm); values in data units.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/settings.h"
#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

struct SuggestedIsovalue {
  std::string name;  // "otsu"; "bone" and "skin" for Hounsfield units; "surface"
  double isovalue = 0.0;
  std::string reason;  // a few words
};

struct ValueHistogram {
  // Equal bins over low .. high. Values outside count in the first and the last bin.
  double low = 0.0;
  double high = 1.0;
  std::vector<std::uint64_t> counts;
  std::vector<double> peaks;  // ascending, without the background
};

struct VolumeInfo {
  std::string source;  // path on the daemon's machine, builtin name, or "upload:NAME"
  std::uint64_t volume_revision = 0;
  std::uint64_t loaded_revision = 0;  // the load; later revisions are edits and frames
  Vec3i size = Vec3i::Zero();         // voxels
  Vec3 spacing_mm = Vec3::Zero();
  double value_min = 0.0;  // at load
  double value_max = 0.0;
  std::string unit;           // as the file states it, such as "HU"; empty: the file states none
  std::string original_type;  // such as "uint8"
  bool is_level_set = false;
  AffineMap world_from_index;
  AffineMap device_from_index;
  double device_mm_per_volume_mm = 0.0;
  // Where +x, +y and +z of world_from_index point in the patient, such as "LPS"; empty: unknown.
  std::string patient_axes;
  bool axes_are_answered = false;  // by a person (PlacementChange::facing), not stated by the file
  std::uint64_t memory_bytes = 0;
  std::uint32_t frames = 0;         // frames of the source file; this volume is one of them
  std::uint64_t unsaved_edits = 0;  // since the voxels were loaded or saved
  // What the import assumed or left out, one line each.
  std::vector<std::string> warnings;
  // Of the volume as loaded. A load without an isovalue starts at the first.
  std::vector<SuggestedIsovalue> suggested_isovalues;
  ValueHistogram histogram;
};

using palpate::VoxelType;

// A file that holds only voxels, x fastest.
struct RawVoxels {
  Vec3i size = Vec3i::Zero();
  VoxelType type = VoxelType::kUint8;
  bool big_endian = false;
  std::uint64_t offset_bytes = 0;  // the bytes before the first voxel
};

// Absent fields: as the file says, or unchanged.
struct LoadOptions {
  // Set at most one of the two. Neither: the first of the volume's suggested isovalues.
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::optional<Vec3> spacing_mm{};
  std::optional<double> device_mm_per_volume_mm{};  // absent: fits the workspace
  std::optional<RawVoxels> raw{};
  std::optional<std::uint32_t> frame{};  // for a file with several frames; 0 is the first
  std::string grid{};                    // for a .vdb file with several grids: NAME, or NAME[K]
  std::string component{};               // for a grid of vectors: magnitude, x, y or z
  // Otherwise a volume with edits that are not saved is not replaced.
  bool discard_edits = false;
  // Felt from the same tick on as the volume. Without expected_revision.
  SettingsUpdate settings{};
};

struct LoadResult {
  VolumeInfo volume;
  std::uint64_t applied_tick = 0;  // first tick that used it
  std::uint64_t settings_revision = 0;
  double isovalue = 0.0;  // that it starts at, data units
};

struct SaveResult {
  std::uint64_t volume_revision = 0;  // the revision that was written
  std::uint64_t size_bytes = 0;
};

}  // namespace palpate::client
