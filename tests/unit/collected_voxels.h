// What a reader of palpate-import delivers, as floats.
#pragma once

#include <optional>
#include <vector>

#include "server/import/voxel_reader.h"

namespace palpate::testing {

struct CollectedVoxels {
  std::vector<float> values;
  std::optional<LeafType> type;

  VoxelSink Sink() {
    return [this](LeafType is, const void* voxels, std::size_t count) {
      type = is;
      VisitType(is, [&](auto voxel) {
        const auto* const first = static_cast<const decltype(voxel)*>(voxels);
        values.insert(values.end(), first, first + count);
      });
    };
  }
};

}  // namespace palpate::testing
