// How palpate-import hands a volume to the daemon: in a file in memory (memfd) that the daemon made
// and seals, with a fixed header and voxels in a row. Nothing is parsed: the daemon checks a few
// numbers, and what it takes can be wrong voxels, but nothing worse.
//
// Layout, in the machine's own byte order, since both run on it: HandoverHeader at 0, voxels at
// kHandoverVoxels, x fastest, and not a byte more.
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>

#include "common/files/descriptor.h"
#include "server/volume/dense_bricks.h"

namespace palpate {

inline constexpr std::int64_t kHandoverVoxels = 16384;

struct HandoverHeader {
  static constexpr char kMagic[8] = {'P', 'A', 'L', 'P', 'V', 'O', 'X', '1'};

  char magic[8];
  std::int32_t size[3];  // voxels along x, y, z
  std::int32_t frames;
  std::uint32_t type;  // LeafType
  std::uint32_t reserved;
  double spacing_mm[3];
  double origin_W_mm[3];
  double direction[9];  // row by row
  double value_min;     // of the voxels, exactly
  double value_max;
  char unit[kLongestText + 8];  // texts end with a 0
  char original_type[kLongestText + 8];
  char source[kLongestText + 8];
};
static_assert(sizeof(HandoverHeader) <= kHandoverVoxels);

// An empty file in memory that can be sealed. Closed on exec.
Descriptor MakeHandoverFile();

// The importer's side: writes metadata and voxels, as many as metadata.size says, in the type,
// which holds each of them exactly.
void WriteHandover(int fd, const VolumeMetadata& metadata, LeafType type, const float* voxels);

struct TakeOptions {
  std::int64_t max_voxels = std::int64_t{1} << 31;
  // Told of the volume before memory is taken for it; what it throws ends the taking.
  std::function<void(const Vec3i& size, LeafType type)> on_size{};
  // Told the fraction that is done; what it throws ends the taking.
  std::function<void(double fraction)> progress{};
};

// The daemon's side: seals the file against every change and takes the volume out of it.
// kInvalidArgument for what no importer of ours writes; kTooLarge beyond max_voxels.
LoadedVolume TakeHandover(int fd, const TakeOptions& options = {});

}  // namespace palpate
