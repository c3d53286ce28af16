// The messages of a volume stream, without gRPC. volume_stream.proto explains each message and
// their order. common/wire converts them.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/bricks/brick.h"
#include "common/bricks/brick_map.h"
#include "common/bricks/leaf_type.h"
#include "common/contract/volume_stream.h"
#include "common/geometry/geometry.h"

namespace palpate {

struct VolumeLattice {
  std::string source;
  Vec3i size = Vec3i::Zero();  // voxels
  Vec3 spacing_mm = Vec3::Ones();
  AffineMap X_WI;
  double value_min = 0.0;  // data units
  double value_max = 0.0;
  // The value beyond the lattice and of bricks that are not sent; value_min unless stated.
  std::optional<double> background{};
  std::string unit;
  // The window that the file proposes for pictures; width 0: none.
  double window_level = 0.0;
  double window_width = 0.0;
  std::uint64_t loaded_revision = 0;
  // Of the file's voxels. An edit may give a brick another type.
  LeafType type = LeafType::kFloat;

  Vec3i BrickCounts() const {
    return {BrickCount(size.x()), BrickCount(size.y()), BrickCount(size.z())};
  }
  std::uint64_t Bricks() const { return BrickCounts().cast<std::uint64_t>().prod(); }
  float Background() const { return static_cast<float>(background.value_or(value_min)); }
};

// A block of the overview has this many voxels along each axis.
inline constexpr int kOverviewEdge = 4;
constexpr int OverviewCount(int size) { return (size + kOverviewEdge - 1) / kOverviewEdge; }

// Bricks with one value throughout.
struct VolumeTile {
  BrickRun bricks;
  float value = 0.0f;
};

struct VolumeBricks {
  LeafType type = LeafType::kFloat;
  std::vector<std::uint64_t> numbers;
  std::string zstd_values;
  std::vector<VolumeTile> tiles;
  std::uint64_t bricks_left = 0;
};

struct VolumeComplete {
  VolumeRevision revision;
  ContentHash content_hash;
  // Of the same lattice if all voxels were background. A client needs no hash of bricks that did
  // not come.
  ContentHash background_hash;
};

using VolumeEvent =
    std::variant<VolumeLattice, VolumePlacement, VolumeOverview, VolumeBricks, VolumeComplete>;

struct VolumeMessage {
  std::uint64_t number = 0;  // 1, 2, 3, ... within a stream
  VolumeEvent event;
};

}  // namespace palpate
