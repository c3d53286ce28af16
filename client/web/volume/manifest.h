// A manifest: names every blob of one state of a volume. JSON:
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

#include <string>
#include <string_view>
#include <vector>

#include "common/bricks/brick.h"
#include "common/bricks/leaf_type.h"
#include "common/bricks/volume_event.h"
#include "common/geometry/geometry.h"

namespace palpate::web {

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
