// Leaves out of voxels that lie in a row, as files hold them.
//
// Not for real-time code. Threads: pure, any.
#pragma once

#include <cstdint>
#include <functional>

#include "server/volume/brick_directory.h"
#include "server/volume/leaf_type.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

// A volume that nobody feels yet.
struct LoadedVolume {
  VolumeMetadata metadata;
  BrickDirectory bricks;
};

// Puts rows first_y .. end_y - 1 of layer z, x fastest, to `rows`.
using ReadRows = std::function<void(int z, int first_y, int end_y, void* rows)>;

// Of size_voxels of the type. Reads each row once, layer by layer within 64 rows of 64 layers, and
// holds no more than these (StripBytes) beside the leaves. Voxels of other values than `background`
// are active. What `read` throws ends it.
BrickDirectory MakeBricks(const Vec3i& size_voxels, LeafType type, const ReadRows& read,
                          float background);

std::uint64_t StripBytes(const Vec3i& size_voxels, LeafType type);

}  // namespace palpate
