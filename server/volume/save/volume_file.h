// Writes a volume as a .vdb file: one grid, blosc compressed. The grid's transform maps voxel index
// to W (mm, LPS), and its metadata palpate_* hold VolumeMetadata. A volume from a .vdb file becomes
// its original grid again (grid_tree.h), with its name and metadata. Any other volume becomes a
// grid "density" that begins with voxel (0,0,0).
//
// Any thread; not for real-time code (writes files, allocates).
#pragma once

#include <filesystem>
#include <functional>
#include <string_view>

#include "common/files/new_file.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/grid_tree.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Writes to an open or new file. type: as GridTypeOf says. The metadata must be valid. `written`:
// called from time to time with the fraction of bytes, about. Throws std::ios_base::failure; errno
// says why.
void WriteGridFile(const std::filesystem::path& path, std::string_view type, const NextLeaf& next,
                   const VolumeMetadata& metadata,
                   const std::function<void(double fraction)>& written);

// `path` is either complete or unchanged. Does not wait for the disk. Throws Error:
// kInvalidArgument (metadata), or as WriteWhole.
void WriteVolumeFile(const std::filesystem::path& path, const BrickDirectory& bricks,
                     const VolumeMetadata& metadata, IfThere if_there = IfThere::kReplace);

}  // namespace palpate
