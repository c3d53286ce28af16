// The .vdb file in which palpate-import hands a volume to the daemon: one
// openvdb::FloatGrid "density", blosc compressed, whose voxel (0,0,0) is the
// first of the volume, whose background is the least value, whose transform maps
// voxel index to W (mm, LPS), and whose metadata palpate_* hold VolumeMetadata.
//
// Any thread; not for real-time code (reads and writes files, allocates).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "common/files/new_file.h"
#include "server/volume/float_grid.h"
#include "server/volume/volume_metadata.h"

namespace palpate {

struct VolumeFile {
  std::shared_ptr<openvdb::FloatGrid> grid;
  VolumeMetadata metadata;
};

// Spacings that a volume may have, mm: the determinant of a finer one is zero to
// OpenVDB.
constexpr double kLeastSpacingMm = 1e-4;
constexpr double kGreatestSpacingMm = 1e6;

// Throws Error(kInvalidArgument) with one clear line when sizes, spacing, frame
// or range are not those of a volume.
void CheckVolumeMetadata(const VolumeMetadata& metadata);

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

// Reads all voxels at once: nothing is loaded later from the disk.
// Throws Error: kNotFound, or kInvalidArgument for a file that WriteVolumeFile
// did not write, of another format number, incomplete or damaged.
VolumeFile ReadVolumeFile(const std::filesystem::path& path);

}  // namespace palpate
