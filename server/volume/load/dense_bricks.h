// Makes leaves from voxels in a row, the order of voxels in files.
//
// Not for real-time code. Threads: pure, any.
#pragma once

#include <cstdint>
#include <functional>

#include "common/bricks/leaf_type.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// A loaded volume, not yet published.
struct LoadedVolume {
  VolumeMetadata metadata;
  BrickDirectory bricks;
};

// Copies rows first_y .. end_y - 1 of layer z, x fastest, to `rows`.
using ReadRows = std::function<void(int z, int first_y, int end_y, void* rows)>;

// Makes a directory of size_voxels voxels of this type. Reads each row once, layer by layer, in
// strips of 64 rows by 64 layers. Holds only one strip (StripBytes) besides the leaves. Voxels that
// differ from `background` are active. An exception from `read` ends the function.
BrickDirectory MakeBricks(const Vec3i& size_voxels, LeafType type, const ReadRows& read,
                          float background);

std::uint64_t StripBytes(const Vec3i& size_voxels, LeafType type);

// The memory that loading a volume takes in this process, known before the load takes it.
struct LoadMemory {
  std::uint64_t volume_bytes = 0;   // the most that the volume takes
  std::uint64_t passing_bytes = 0;  // taken besides until the volume is loaded
  std::uint64_t Sum() const { return volume_bytes + passing_bytes; }
};

// The memory for voxels in a row, handed over in memory and read strip by strip.
inline LoadMemory DenseLoadMemory(const Vec3i& size, LeafType type) {
  const auto voxels = static_cast<std::uint64_t>(size.cast<std::int64_t>().prod());
  return {.volume_bytes = BrickDirectory::MemoryBytes(size, type),
          .passing_bytes = voxels * VoxelBytes(type) + StripBytes(size, type)};
}

}  // namespace palpate
