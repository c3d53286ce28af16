// What a grid of a .vdb file is besides its voxels: kept from when it is loaded, so that it is
// saved as it was.
//
// The daemon's volume begins at a voxel of the grid whose indices are multiples of 8, so that
// leaves are leaves here and there. Tiles that lie in the lattice are not kept here if they have 8³
// voxels: the volume holds them, as constant leaves.
//
// Frame: the grid's indices; voxel (0,0,0) of the volume is `first`. Values in data units.
// Plain values, no OpenVDB. Threads: any, once made.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/volume/leaf.h"

namespace palpate {

// Types of the grids that are read and written, as OpenVDB names them.
inline constexpr std::string_view kGridTypes[] = {"float", "double", "int32", "int64", "bool"};

// OpenVDB's linear maps.
inline constexpr std::string_view kGridMaps[] = {"UniformScaleMap", "UniformScaleTranslateMap",
                                                 "ScaleMap",        "ScaleTranslateMap",
                                                 "TranslationMap",  "UnitaryMap",
                                                 "AffineMap"};

// Bricks along a side of inner nodes, in voxels.
inline constexpr int kGridNodeEdge = 128, kGridTopNodeEdge = 4096;

// A cube of one value.
struct GridTile {
  Vec3i first = Vec3i::Zero();
  std::int32_t edge = 0;  // voxels: 8, 128 or 4096
  float value = 0.0f;
  bool is_active = false;
};

// Types of metadata that are kept, as OpenVDB names them, with their size; 0: any.
struct GridEntryType {
  std::string_view name;
  std::size_t bytes;
};
inline constexpr GridEntryType kGridEntryTypes[] = {
    {"string", 0}, {"bool", 1},   {"int32", 4},  {"int64", 8},  {"float", 4},  {"double", 8},
    {"vec2i", 8},  {"vec2s", 8},  {"vec2d", 16}, {"vec3i", 12}, {"vec3s", 12}, {"vec3d", 24},
    {"vec4i", 16}, {"vec4s", 16}, {"vec4d", 32}, {"mat4s", 64}, {"mat4d", 128}};

// A value as it lies in memory.
struct GridEntry {
  std::string name;
  const GridEntryType* type = nullptr;
  std::string bytes;
};

struct GridLeaf {
  Vec3i first = Vec3i::Zero();
  LeafPtr leaf;
};

struct GridForm {
  Vec3i first = Vec3i::Zero();  // multiples of 8
  std::string_view type = kGridTypes[0];
  float background = 0.0f;
  // How index becomes world, of kGridMaps, with OpenVDB's matrix for row vectors, row by row.
  // Empty: as the volume's metadata say.
  std::string_view map{};
  std::array<double, 16> matrix{};
  std::vector<GridEntry> entries{};
  std::vector<Vec3i> top_nodes{};  // first voxels
  std::vector<Vec3i> nodes{};
  // All but those that are as the background and inactive.
  std::vector<GridTile> tiles{};
  std::vector<GridLeaf> outer_leaves{};  // beyond the lattice
};

}  // namespace palpate
