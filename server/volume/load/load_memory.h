// The memory that loading a volume takes in this process, known before the load takes it.
//
// Threads: pure, any.
#pragma once

#include <cstdint>

#include "server/volume/load/dense_bricks.h"
#include "server/volume/snapshot/brick_directory.h"

namespace palpate {

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
