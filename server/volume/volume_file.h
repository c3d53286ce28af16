// Writes a volume as a .vdb file: one grid, blosc compressed. The grid's transform maps voxel index
// to W (mm, LPS), and its metadata palpate_* hold VolumeMetadata. A volume from a .vdb file becomes
// its original grid again (grid_tree.h), with its name and metadata. Any other volume becomes a
// grid "density" that begins with voxel (0,0,0).
//
// Any thread; not for real-time code (writes files, allocates).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "common/files/new_file.h"
#include "server/volume/brick_directory.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct WriteOptions {
  IfThere if_there = IfThere::kReplace;
  Durable durable = Durable::kYes;
  Links links = Links::kFollowed;
  // Called from time to time with the number of bytes so far; it may throw to cancel.
  std::function<void(std::uint64_t bytes)> written{};
};

// Writes a new file beside `path` and renames it, so `path` is either complete or unchanged. Throws
// Error: kInvalidArgument (metadata), or as WriteWhole.
void WriteVolumeFile(const std::filesystem::path& path, const BrickDirectory& bricks,
                     const VolumeMetadata& metadata, const WriteOptions& options = {});

}  // namespace palpate
