// Reads a volume of any supported format by running palpate-import. So a damaged or hostile file
// can harm only a separate process.
//
// Any ordinary thread (blocks for the whole import); never the servo's. Uses posix_spawn, because
// fork would make the servo's pages copy-on-write.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/files/own_files.h"
#include "server/volume/load/dense_bricks.h"

namespace palpate {

// Describes a file that holds only voxels. Plain values.
struct RawVoxels {
  std::array<std::int64_t, 3> size{};  // voxels along x (fastest), y, z
  std::string type;  // "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"
  bool big_endian = false;
  std::int64_t offset_bytes = 0;  // position of the first voxel

  bool operator==(const RawVoxels&) const = default;
};

using SizeKnown = std::function<void(const Vec3i& size, const LoadMemory& memory)>;

struct ImportRequest {
  std::filesystem::path source;       // a file, or the folder of a series
  std::optional<Vec3> spacing_mm;     // replaces the file's; required if that states none
  std::optional<std::int64_t> frame;  // frame of a 4-D file; default: the first
  std::optional<RawVoxels> raw;       // set if the file holds only raw voxels
  std::string grid{};                 // name of the grid, for a .vdb file with several
  std::string component{};            // for a grid of vectors: magnitude, x, y or z
  // Folders that limit the files to read. The source, and every file that it names (slices, voxels
  // of a detached header), must lie below the source's folder or one of these, with links followed.
  // The paths here must hold no links. None: files may lie anywhere.
  std::optional<std::vector<std::filesystem::path>> folders{};
  // Files that must not be read.
  OwnFiles own_files{};
  std::int64_t max_voxels = std::int64_t{1} << 31;
  std::int64_t max_memory_bytes = std::int64_t{16} << 30;
  // Called with the size and the expected memory before voxels are read; for stacks of slices more
  // than once. Called again with the final size before the volume is taken over. An exception from
  // it ends the import.
  SizeKnown on_size{};
  std::chrono::seconds timeout{300};
  std::filesystem::path import_program;  // palpate-import
};

// `progress`: called with the present stage and the fraction done, on the calling thread.
// `cancelled`: asked several times a second. Both may be empty. `warnings`: the importer's warnings
// are appended, unless null.
//
// Throws Error with the importer's one line; kCancelled if cancelled() returned true; kTooLarge if
// a limit was exceeded. No process remains.
LoadedVolume ImportVolume(
    const ImportRequest& request,
    const std::function<void(std::string_view stage, double fraction)>& progress,
    const std::function<bool()>& cancelled, std::vector<std::string>* warnings = nullptr);

}  // namespace palpate
