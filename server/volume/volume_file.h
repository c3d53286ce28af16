// The .vdb file as which a volume is saved: one grid, blosc compressed, whose transform maps voxel
// index to W (mm, LPS), and whose metadata palpate_* hold VolumeMetadata. A volume out of a .vdb
// file becomes the grid that it came from (grid_tree.h), with its name and metadata; any other one
// "density", with voxel (0,0,0) first.
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
  // Told now and then how many bytes there are so far; gives up by throwing.
  std::function<void(std::uint64_t bytes)> written{};
};

// Writes beside `path` and renames, so that `path` is either whole or as it was.
// Throws Error: kInvalidArgument (metadata), or as WriteWhole.
void WriteVolumeFile(const std::filesystem::path& path, const BrickDirectory& bricks,
                     const VolumeMetadata& metadata, const WriteOptions& options = {});

}  // namespace palpate
