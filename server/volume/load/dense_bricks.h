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

}  // namespace palpate
