// Hands a volume from palpate-import to the daemon: in a file in memory (memfd) that the daemon
// makes and seals. The file has a fixed header, and either voxels in a row, or the leaves and tiles
// of a tree (handover_layout.h). The daemon parses nothing, it only checks numbers. So the worst
// that a bad file can cause is wrong voxels.
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>

#include "common/files/descriptor.h"
#include "server/volume/load/dense_bricks.h"
#include "server/volume/load/handover_layout.h"
#include "server/volume/load/load_memory.h"

namespace palpate {

// Makes an empty file in memory that can be sealed. It is closed on exec.
Descriptor MakeHandoverFile();

// The most voxels in the lattice of a tree.
inline constexpr std::int64_t kMostLatticeVoxels = std::int64_t{1} << 36;

// The importer's side: makes the fixed part of the header, without the tree's part.
HandoverHeader MakeHandoverHeader(const VolumeMetadata& metadata, LeafType type);

// The metadata in a header. Not checked. Throws kInvalidArgument for a text without an end.
VolumeMetadata MetadataOf(const HandoverHeader& header);

struct TakeOptions {
  // For a tree: the limit for the voxels in its leaves.
  std::int64_t max_voxels = std::int64_t{1} << 31;
  // Called before memory is taken for the volume; an exception from it ends the take-over.
  std::function<void(const Vec3i& size, const LoadMemory& memory)> on_size{};
  // Called with the fraction done; an exception from it ends the take-over.
  std::function<void(double fraction)> progress{};
};

// The daemon's side: seals the file against every change and takes the volume out of it. Throws
// kInvalidArgument if the file is not from our importer; kTooLarge above max_voxels.
LoadedVolume TakeHandover(int fd, const TakeOptions& options = {});

}  // namespace palpate
