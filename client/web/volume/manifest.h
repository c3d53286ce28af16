// A volume's groups of voxels, and its manifest: names every blob of one state of the volume. JSON:
//   {"lattice": {"size": [x, y, z], "voxel_type", "background", "value_min", "value_max",
//                "factor": 1},
//    "revision", "daemon_id": text, "content_hash": 32 hex digits, of the daemon's,
//    "overview": {"name", "size": [x, y, z], "factor"},
//    "groups": base64 of 16 bytes per group; zeros: background. Empty without groups}
//
// Names: group and overview: HashOfBytes of the LeafType and the voxels; manifest: of 255 and the
// text. A group that is all background has none.
//
// Threads: pure. Errors: as stated.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/bricks/brick.h"
#include "common/bricks/brick_map.h"
#include "common/bricks/leaf_type.h"
#include "common/bricks/volume_event.h"
#include "common/geometry/geometry.h"

namespace palpate::web {

inline constexpr int kGroupEdge = 32;
inline constexpr int kGroupVoxels = kGroupEdge * kGroupEdge * kGroupEdge;
inline constexpr int kGroupBricks = kGroupEdge / kBrickEdge;  // along an axis

// Returns the number of groups along an axis of `bricks` bricks.
constexpr int GroupCount(int bricks) { return (bricks + kGroupBricks - 1) / kGroupBricks; }

// Groups of 32³ voxels, in which browsers fetch a volume.
//
// Frame: I, voxel indices. Group (a, b, c) holds the voxels 32a to 32a + 31 along x, and likewise
// along y and z. Voxel (i, j, k) of a group is at 1024 i + 32 j + k. With nb and nc groups along y
// and z, the group's number is (a nb + b) nc + c. Voxels beyond the lattice are the background.
// Values in data units, little-endian.
//
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

struct Manifest {
  Vec3i size = Vec3i::Zero();  // voxels
  LeafType type = LeafType::kUint8;
  float background = 0.0F;
  double value_min = 0.0, value_max = 0.0;
  VolumeRevision revision;
  ContentHash content_hash{};
  ContentHash overview{};
  Vec3i overview_size = Vec3i::Zero();  // blocks
  int overview_factor = 1;
  std::vector<ContentHash> groups;  // by number; zero: background. Empty: the overview alone
};

std::string ToJson(const Manifest& manifest);
// What names the blobs: size, type, overview and groups; the rest of the result is not filled in.
// Errors: kInvalidArgument (no manifest, or not as many groups as the lattice has).
Manifest ParseManifest(std::string_view json);

// The names of a manifest's text, and of voxels.
ContentHash HashOfManifest(std::string_view json);
ContentHash HashOfVoxels(LeafType type, std::string_view bytes);

}  // namespace palpate::web
