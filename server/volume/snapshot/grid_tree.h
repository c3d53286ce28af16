// Converts a volume to a tree of OpenVDB, with the type and form of its original grid.
//
// Not for real-time code. Threads: any. Ownership: the tree is a copy.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/volume/snapshot/brick_directory.h"
#include "server/volume/snapshot/leaf.h"
#include "server/volume/snapshot/openvdb_names.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

// Types of grids that can be read and written, with OpenVDB's names.
inline constexpr std::string_view kGridTypes[] = {"float", "double", "int32", "int64", "bool"};

// OpenVDB's linear maps.
inline constexpr std::string_view kGridMaps[] = {"UniformScaleMap", "UniformScaleTranslateMap",
                                                 "ScaleMap",        "ScaleTranslateMap",
                                                 "TranslationMap",  "UnitaryMap",
                                                 "AffineMap"};

// Edges of inner nodes, in voxels.
inline constexpr int kGridNodeEdge = 128, kGridTopNodeEdge = 4096;

// A cube of one value.
struct GridTile {
  Vec3i first = Vec3i::Zero();
  std::int32_t edge = 0;  // voxels: 8, 128 or 4096
  float value = 0.0f;
  bool is_active = false;
};

// Types of metadata that are kept, with OpenVDB's names and their sizes in bytes; 0: any size.
struct GridEntryType {
  std::string_view name;
  std::size_t bytes;
};
inline constexpr GridEntryType kGridEntryTypes[] = {
    {"string", 0}, {"bool", 1},   {"int32", 4},  {"int64", 8},  {"float", 4},  {"double", 8},
    {"vec2i", 8},  {"vec2s", 8},  {"vec2d", 16}, {"vec3i", 12}, {"vec3s", 12}, {"vec3d", 24},
    {"vec4i", 16}, {"vec4s", 16}, {"vec4d", 32}, {"mat4s", 64}, {"mat4d", 128}};

// A value, as its bytes in memory.
struct GridEntry {
  std::string name;
  const GridEntryType* type = nullptr;
  std::string bytes;
};

struct GridLeaf {
  Vec3i first = Vec3i::Zero();
  LeafPtr leaf;
};

// The parts of a .vdb file's grid other than the volume's voxels. They are kept from the load on,
// so that the grid is saved as it was.
//
// The daemon's volume begins at a voxel of the grid whose indices are multiples of 8, so that the
// grid's leaves are the volume's leaves. Tiles of 8³ voxels within the lattice are not kept here:
// the volume holds them as constant leaves.
//
// Frame: the grid's indices; voxel (0,0,0) of the volume is `first`. Values in data units.
// Plain values, no OpenVDB. Threads: any, after construction.
struct GridForm {
  Vec3i first = Vec3i::Zero();  // multiples of 8
  std::string_view type = kGridTypes[0];
  float background = 0.0f;
  // The map from index to world, one of kGridMaps, with OpenVDB's matrix for row vectors, row by
  // row. Empty: the map of the volume's metadata.
  std::string_view map{};
  std::array<double, 16> matrix{};
  std::vector<GridEntry> entries{};
  std::vector<Vec3i> top_nodes{};  // the first voxels of the nodes
  std::vector<Vec3i> nodes{};
  // All tiles except inactive tiles with the background's value.
  std::vector<GridTile> tiles{};
  std::vector<GridLeaf> outer_leaves{};  // leaves beyond the lattice
};

// Returns the type of kGridTypes that holds the volume's values. Candidates are the type of the
// original grid; int32 for voxels that are integers in their file; otherwise float.
std::string_view GridTypeOf(const BrickDirectory& bricks, const VolumeMetadata& metadata);

// Returns the leaf of the next brick, z fastest. It must be valid until the next call.
using NextLeaf = std::function<const Leaf&()>;
NextLeaf LeavesOf(const BrickDirectory& bricks);

// Makes a grid of type Grid. If the volume came from a .vdb file, every value, state, tile and node
// is as it was, except for changes made since. Otherwise, the background is the value outside
// (VolumeMetadata::Background), and voxels that differ from it are active.
template <class Grid>
std::shared_ptr<Grid> MakeGrid(const NextLeaf& next, const VolumeMetadata& metadata);

}  // namespace palpate
