// The .vdb file as which a volume is saved: one
// openvdb::FloatGrid "density", blosc compressed, whose voxel (0,0,0) is the
// first of the volume, whose background is the least value, whose transform maps
// voxel index to W (mm, LPS), and whose metadata palpate_* hold VolumeMetadata.
//
// Any thread; not for real-time code (writes files, allocates).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "common/files/new_file.h"
#include "server/volume/openvdb_names.h"
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
// Of `grid` only the tree is written; name, transform and metadata are replaced.
// Throws Error: kInvalidArgument (metadata, or a tree that does not fit them),
// or as WriteWhole.
void WriteVolumeFile(const std::filesystem::path& path, const openvdb::FloatGrid& grid,
                     const VolumeMetadata& metadata, const WriteOptions& options = {});

}  // namespace palpate
