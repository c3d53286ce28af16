// How palpate-import hands a volume to the daemon: in a file in memory (memfd) that the daemon made
// and seals, with a fixed header and voxels in a row, or the leaves and tiles of a tree
// (handover_layout.h). Nothing is parsed: the daemon checks numbers, and what it takes can be wrong
// voxels, but nothing worse.
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>

#include "common/files/descriptor.h"
#include "server/volume/dense_bricks.h"
#include "server/volume/handover_layout.h"
#include "server/volume/load_memory.h"

namespace palpate {

// An empty file in memory that can be sealed. Closed on exec.
Descriptor MakeHandoverFile();

// Places of a lattice that is a tree's, at most.
inline constexpr std::int64_t kMostLatticeVoxels = std::int64_t{1} << 36;

// The importer's side: the fixed part, without what a tree adds.
HandoverHeader MakeHandoverHeader(const VolumeMetadata& metadata, LeafType type);

// Writes metadata and voxels, as many as metadata.size says, in the type,
// which holds each of them exactly.
void WriteHandover(int fd, const VolumeMetadata& metadata, LeafType type, const float* voxels);

struct TakeOptions {
  // Of a tree: in its leaves.
  std::int64_t max_voxels = std::int64_t{1} << 31;
  // Told of the volume before memory is taken for it; what it throws ends the taking.
  std::function<void(const Vec3i& size, const LoadMemory& memory)> on_size{};
  // Told the fraction that is done; what it throws ends the taking.
  std::function<void(double fraction)> progress{};
};

// The daemon's side: seals the file against every change and takes the volume out of it.
// kInvalidArgument for what no importer of ours writes; kTooLarge beyond max_voxels.
LoadedVolume TakeHandover(int fd, const TakeOptions& options = {});

}  // namespace palpate
