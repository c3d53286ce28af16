// Saves a volume, with its edits, to a file that LoadVolume can read again.
//
// Any thread; not for real-time code: reads the snapshot until the file is written.
// Errors: Error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string_view>

#include "server/volume/snapshot/snapshot.h"

namespace palpate {

struct ExportRequest {
  // Absolute and without links. Ends with .vdb (as palpate-import writes it) or .nrrd (gzip, in the
  // smallest type that holds all voxels).
  std::filesystem::path path;
  bool overwrite = false;
  std::filesystem::path save_program{};  // palpate-import, which writes .vdb
};

// The most memory that the export takes besides the volume.
std::uint64_t ExportBytes(const VolumeSnapshot& volume, const std::filesystem::path& path);

using ExportProgress = std::function<void(std::string_view stage, double fraction)>;
using ExportCancelled = std::function<bool()>;

// Returns the size of the file in bytes. The file is either complete or as before, even if the
// process is killed. A process of its own writes .vdb: OpenVDB ends a process that has too little
// memory. Only one export to a path at a time.
// Throws kInvalidArgument (an unknown format, or not a file's path), kConflict (the file exists and
// overwrite is false), kCancelled, or as WriteWhole.
std::uint64_t ExportVolume(const VolumeSnapshot& volume, const ExportRequest& request,
                           const ExportProgress& progress, const ExportCancelled& cancelled);

}  // namespace palpate
