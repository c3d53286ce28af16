// What lies in the file in memory that palpate-import hands over (handover.h).
//
// Plain bytes in the machine's own order, since both programs run on it. HandoverHeader at 0; from
// kHandoverVoxels on either voxels in a row, x fastest, or a tree of OpenVDB's in parts, one behind
// the other, as many of each as the header says:
//   entries (bytes), top nodes (int32[3]), tiles (HandoverTile), nodes (HandoverNode),
//   first voxels of leaves (int32[3]), leaves (64 bytes of states, then 8³ voxels of the type).
// Not a byte more. Of a tree, all places are the grid's indices.
#pragma once

#include <cstdint>

#include "server/volume/volume_metadata.h"

namespace palpate {

inline constexpr std::int64_t kHandoverVoxels = 16384;

enum class HandoverForm : std::uint32_t { kDense = 0, kTree = 1 };

// Of a tree only; all 0 otherwise.
struct HandoverTree {
  std::int32_t first[3];  // of the lattice
  float background;
  std::uint32_t grid_type;  // of kGridTypes
  std::uint32_t map;        // of kGridMaps; their number: none
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
  static constexpr char kMagic[8] = {'P', 'A', 'L', 'P', 'V', 'O', 'X', '2'};

  char magic[8];
  std::int32_t size[3];  // voxels along x, y, z
  std::int32_t frames;
  std::uint32_t type;  // LeafType
  std::uint32_t form;  // HandoverForm
  double spacing_mm[3];
  double origin_W_mm[3];
  double direction[9];  // row by row
  double value_min;     // of the voxels, exactly; not stated of a tree
  double value_max;
  char unit[kLongestText + 8];  // texts end with a 0
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

// 16³ places of 8³ voxels, place (a, b, c) at 256 a + 16 b + c: a leaf, or a tile.
struct HandoverNode {
  static constexpr int kPlaces = 4096;
  std::int32_t first[3];
  std::uint32_t reserved;
  std::uint64_t is_leaf[kPlaces / 64];
  std::uint64_t is_active[kPlaces / 64];
  float values[kPlaces];
};

// Of an entry; name and value follow, and the next entry.
struct HandoverEntry {
  std::uint32_t type;  // of kGridEntryTypes
  std::uint32_t name_bytes;
  std::uint32_t value_bytes;
};
inline constexpr std::uint64_t kMostEntryBytes = std::uint64_t{1} << 20;

}  // namespace palpate
