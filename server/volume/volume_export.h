// Saves a volume, with its edits, to a file that LoadVolume reads again.
//
// Any thread; not for real-time code: reads the snapshot for as long as it takes.
// Errors: Error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string_view>

#include "server/volume/snapshot.h"

namespace palpate {

struct ExportRequest {
  // Absolute, without links on its way; ends with .vdb (as palpate-import writes it) or .nrrd
  // (gzip, in the smallest type that holds all voxels).
  std::filesystem::path path;
  bool overwrite = false;
};

// The most memory that it takes beside the volume: a .vdb file is written out of a grid of floats.
std::uint64_t ExportBytes(const VolumeSnapshot& volume, const std::filesystem::path& path);

using ExportProgress = std::function<void(std::string_view stage, double fraction)>;
using ExportCancelled = std::function<bool()>;

// Returns the size of the file, bytes. The file is whole or as it was before, even
// when the process is killed; "PATH.XXXXXX.partial" may be left then. One export to a path at a
// time. kInvalidArgument (an unknown format, no file's path), kConflict (the file is there and not
// to be overwritten), kCancelled, or as WriteWhole.
std::uint64_t ExportVolume(const VolumeSnapshot& volume, const ExportRequest& request,
                           const ExportProgress& progress, const ExportCancelled& cancelled);

}  // namespace palpate
