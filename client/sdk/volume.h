// The daemon's volume: what it is, and how another one is loaded. Fields mean what volume.proto
// says.
//
// Frames: I voxel indices, W world (mm, LPS as in DICOM), D device (mm); values in data units.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate::client {

struct VolumeInfo {
  std::string source;  // path on the daemon's machine, builtin name, or "upload:NAME"
  std::uint64_t volume_revision = 0;
  std::uint64_t loaded_revision = 0;  // at which it was loaded; later ones are edits and frames
  Vec3i size = Vec3i::Zero();         // voxels
  Vec3 spacing_mm = Vec3::Zero();
  double value_min = 0.0;  // at load
  double value_max = 0.0;
  std::string unit;           // as the file states it, "HU"; empty: it does not
  std::string original_type;  // such as "uint8"
  bool is_level_set = false;
  AffineMap world_from_index;
  AffineMap device_from_index;
  double device_mm_per_volume_mm = 0.0;
  std::uint64_t memory_bytes = 0;
  std::uint32_t frames = 0;  // of the source file, one of which this is
  // What the import had to assume or leave out, a line each.
  std::vector<std::string> warnings;
};

enum class VoxelType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

// A file that holds nothing but voxels, x fastest.
struct RawVoxels {
  Vec3i size = Vec3i::Zero();
  VoxelType type = VoxelType::kUint8;
  bool big_endian = false;
  std::uint64_t offset_bytes = 0;  // before the first voxel
};

// What is absent is as the file says, or stays.
struct LoadOptions {
  // At most one of the two; neither: the present normalised one, 0 of a level set.
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::optional<Vec3> spacing_mm{};
  std::optional<double> device_mm_per_volume_mm{};  // absent: fits the workspace
  std::optional<RawVoxels> raw{};
  std::optional<std::uint32_t> frame{};  // of a file with several, 0 the first
  std::string grid{};                    // of a .vdb file with several: NAME, or NAME[K]
  std::string component{};               // of a grid of vectors: magnitude, x, y or z
};

struct LoadResult {
  VolumeInfo volume;
  std::uint64_t applied_tick = 0;  // first tick that used it
  std::uint64_t settings_revision = 0;
};

struct SaveResult {
  std::uint64_t volume_revision = 0;  // that was written
  std::uint64_t size_bytes = 0;
};

}  // namespace palpate::client
