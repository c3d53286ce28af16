// Hands a volume from palpate-import to the daemon: in a file in memory (memfd) that the daemon
// makes and seals. The file has a fixed header, and either voxels in a row, or the leaves and tiles
// of a tree. The daemon parses nothing, it only checks numbers. So the worst
// that a bad file can cause is wrong voxels.
//
// Not for real-time code. Threads: any. Errors: Error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "common/files/descriptor.h"
#include "server/volume/load/dense_bricks.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// The layout of the file in memory that palpate-import hands over.
//
// Plain bytes in the machine's own byte order, since both programs run on it. HandoverHeader is at
// 0. At kHandoverVoxels, there are either voxels in a row, x fastest, or the parts of an OpenVDB
// tree, one after the other. The header has the number of each part:
//   entries (bytes), top nodes (int32[3]), tiles (HandoverTile), nodes (HandoverNode), first voxels
//   of leaves (int32[3]), leaves (64 bytes of states, then 8³ voxels of the type).
// The file has no further bytes. All positions of a tree are the grid's indices.

inline constexpr std::int64_t kHandoverVoxels = 16384;

enum class HandoverForm : std::uint32_t { kDense = 0, kTree = 1 };

// Only for a tree; otherwise all 0, but for is_level_set.
struct HandoverTree {
  std::int32_t first[3];  // first voxel of the lattice
  float background;
  std::uint32_t grid_type;  // index into kGridTypes
  std::uint32_t map;        // index into kGridMaps; the size of kGridMaps means none
  double matrix[16];
  std::uint32_t is_level_set;
  std::uint32_t reserved;
  std::uint64_t entry_bytes;
  std::uint64_t top_nodes;
  std::uint64_t tiles;
  std::uint64_t nodes;
  std::uint64_t leaves;
};

struct HandoverHeader {
  static constexpr char kMagic[8] = {'P', 'A', 'L', 'P', 'V', 'O', 'X', '4'};

  char magic[8];
  std::int32_t size[3];  // voxels along x, y, z
  std::int32_t frames;
  std::uint32_t type;  // LeafType
  std::uint32_t form;  // HandoverForm
  double spacing_mm[3];
  double origin_W_mm[3];
  double direction[9];  // row by row
  double value_min;     // exact least value of the voxels; not set for a tree
  double value_max;
  double window_level;
  double window_width;
  char patient_axes[8];  // texts end with a 0
  char unit[kLongestText + 8];
  char original_type[kLongestText + 8];
  char source[kLongestText + 8];
  HandoverTree tree;
};
static_assert(sizeof(HandoverHeader) <= kHandoverVoxels);

struct HandoverTile {
  std::int32_t first[3];
  std::int32_t edge;
  float value;
  std::uint32_t is_active;
};

// 16³ places of 8³ voxels; place (a, b, c) is at 256 a + 16 b + c. Each place is a leaf or a tile.
struct HandoverNode {
  static constexpr int kPlaces = 4096;
  std::int32_t first[3];
  std::uint32_t reserved;
  std::uint64_t is_leaf[kPlaces / 64];
  std::uint64_t is_active[kPlaces / 64];
  float values[kPlaces];
};

// Header of an entry. The entry's name and value follow, then the next entry.
struct HandoverEntry {
  std::uint32_t type;  // index into kGridEntryTypes
  std::uint32_t name_bytes;
  std::uint32_t value_bytes;
};
inline constexpr std::uint64_t kMostEntryBytes = std::uint64_t{1} << 20;

// Reads and writes complete pieces of a hand-over file, or throws an Error.
//
// Not for real-time code. Threads: any.

// Throws kInvalidArgument: the file is not from our importer.
[[noreturn]] void RefuseHandover(const std::string& what);

// Throws for the call that set errno: kTooLarge if there is no room, otherwise kInternal.
[[noreturn]] void FailHandover(const char* what);

void WriteHandoverAt(int fd, const void* data, std::size_t size, std::int64_t offset);
void ReadHandoverAt(int fd, void* data, std::size_t size, std::int64_t offset);

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
