// Groups of 32³ voxels, in which browsers fetch a volume.
//
// Frame: I, voxel indices. Group (a, b, c) holds the voxels 32a to 32a + 31 along x, and likewise
// along y and z. Voxel (i, j, k) of a group is at 1024 i + 32 j + k. With nb and nc groups along y
// and z, the group's number is (a nb + b) nc + c. Voxels beyond the lattice are the background.
// Values in data units, little-endian.
// Threads: pure; a group may be read on any.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>

#include "common/bricks/brick_map.h"

namespace palpate::web {

inline constexpr int kGroupEdge = 32;
inline constexpr int kGroupVoxels = kGroupEdge * kGroupEdge * kGroupEdge;
inline constexpr int kGroupBricks = kGroupEdge / kBrickEdge;  // along an axis

// Returns the number of groups along an axis of `bricks` bricks.
constexpr int GroupCount(int bricks) { return (bricks + kGroupBricks - 1) / kGroupBricks; }

// A group of a map: shares its bricks, and not the map.
class Group {
 public:
  Group(const BrickMap& map, const Vec3i& group, const TypedBrickPtr& background);

  // The smallest type that holds its voxels, as CommonType of its bricks.
  LeafType type() const { return type_; }
  // Its voxels in `type`, which must hold them.
  std::string Bytes(LeafType type) const;

 private:
  // Brick (x, y, z) is at 16 x + 4 y + z.
  std::array<TypedBrickPtr, std::size_t{kGroupBricks} * kGroupBricks * kGroupBricks> bricks_;
  LeafType type_ = LeafType::kUint8;
};

// True if all voxels of these bytes have this value, bit by bit.
bool AreAll(std::string_view bytes, LeafType type, float value);

}  // namespace palpate::web
