// A dense hand-over as palpate-import writes it, of any voxels and metadata.
#pragma once

#include <algorithm>
#include <vector>

#include "server/volume/load/handover.h"

namespace palpate::testing {

// `type` must hold each voxel exactly.
inline void WriteHandover(int fd, const VolumeMetadata& metadata, LeafType type,
                          const std::vector<float>& voxels) {
  const HandoverHeader header = MakeHandoverHeader(metadata, type);
  WriteHandoverAt(fd, &header, sizeof header, 0);
  VisitType(type, [&](auto voxel) {
    std::vector<decltype(voxel)> held(voxels.size());
    std::transform(voxels.begin(), voxels.end(), held.begin(),
                   [](float value) { return static_cast<decltype(voxel)>(value); });
    WriteHandoverAt(fd, held.data(), held.size() * sizeof voxel, kHandoverVoxels);
  });
}

}  // namespace palpate::testing
