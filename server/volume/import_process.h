// Reads a volume of any supported format by running palpate-import, so that a
// damaged or hostile file can harm only a process of its own.
//
// Any ordinary thread (blocks for the whole import); never the servo's. Uses
// posix_spawn, since a fork would make the servo's pages copy-on-write.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/files/own_files.h"
#include "server/volume/dense_bricks.h"
#include "server/volume/load_memory.h"
#include "server/volume/raw_voxels.h"

namespace palpate {

using SizeKnown = std::function<void(const Vec3i& size, const LoadMemory& memory)>;

struct ImportRequest {
  std::filesystem::path source;       // a file, or the folder of a series
  std::optional<Vec3> spacing_mm;     // instead of the file's; required for TIFF
  std::optional<std::int64_t> frame;  // of a 4-D file; the first unless stated
  std::optional<RawVoxels> raw;       // the file holds nothing but these
  std::string grid{};                 // of a .vdb file with several
  std::string component{};            // of a grid of vectors: magnitude, x, y or z
  // The source, and what it leads to (slices, voxels of a detached header), lie below the source's
  // folder or one of these when links are followed. All these paths hold no links. None: anywhere.
  std::optional<std::vector<std::filesystem::path>> folders{};
  // Nor is it any of these.
  OwnFiles own_files{};
  std::int64_t max_voxels = std::int64_t{1} << 31;
  std::int64_t max_memory_bytes = std::int64_t{16} << 30;
  // Told of the size and of the memory that the file promises before voxels are read, more than
  // once for stacks of slices, and of what it has become before it is taken over. Whatever it
  // throws ends the import.
  SizeKnown on_size{};
  std::chrono::seconds timeout{300};
  std::filesystem::path import_program;  // palpate-import
};

// `progress` is told what is done and which fraction of the import is over, on
// the calling thread; `cancelled` is asked several times a second; either may be
// empty. Warnings of the importer are appended to `warnings` when given.
//
// Throws Error with the importer's one line; kCancelled when cancelled() returned
// true; kTooLarge when a limit was hit. No process is left.
LoadedVolume ImportVolume(
    const ImportRequest& request,
    const std::function<void(std::string_view stage, double fraction)>& progress,
    const std::function<bool()>& cancelled, std::vector<std::string>* warnings = nullptr);

}  // namespace palpate
