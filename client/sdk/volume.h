// The daemon's volume, and how to load another one. volume.proto explains the fields.
//
// Frames: I voxel indices, W world (mm, LPS as in DICOM), D device (mm); values in data units.
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "client/sdk/settings.h"
#include "common/contract/enumerations.h"
#include "common/contract/volume.h"
#include "common/geometry/geometry.h"

namespace palpate::client {

using palpate::SuggestedIsovalue;
using palpate::ValueHistogram;
using palpate::VoxelType;

using VolumeInfo = VolumeDescription;
using LoadResult = LoadVolumeResult;
using SaveResult = SaveVolumeResult;

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

}  // namespace palpate::client
