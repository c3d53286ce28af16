#include "client/web/volume/group.h"

#include <algorithm>
#include <cstring>

namespace palpate::web {
namespace {

// `to`: the first voxel of the brick in the group.
template <class T>
void CopyBrick(const TypedBrick& brick, T* to) {
  VisitType(brick.type(), [&](auto voxel) {
    using S = decltype(voxel);
    const S* const values = brick.values<S>();
    for (int row = 0; row < kBrickEdge * kBrickEdge; ++row) {
      T* const line =
          to + (row / kBrickEdge) * kGroupEdge * kGroupEdge + (row % kBrickEdge) * kGroupEdge;
      if (brick.is_constant()) {
        std::fill_n(line, kBrickEdge, static_cast<T>(*values));
      } else {
        const S* const from = values + row * kBrickEdge;
        for (int k = 0; k < kBrickEdge; ++k) line[k] = static_cast<T>(from[k]);
      }
    }
  });
}

}  // namespace

Group::Group(const BrickMap& map, const Vec3i& group, const TypedBrickPtr& background) {
  for (std::size_t n = 0; n < bricks_.size(); ++n) {
    const auto place = static_cast<int>(n);
    const Vec3i brick = group * kGroupBricks + Vec3i(place >> 4, place >> 2 & 3, place & 3);
    const bool is_within = (brick.array() < map.brick_count().array()).all();
    bricks_.at(n) = is_within ? map.At(brick) : background;
    type_ = CommonType(type_, bricks_.at(n)->type());
  }
}

std::string Group::Bytes(LeafType type) const {
  std::string bytes(kGroupVoxels * VoxelBytes(type), '\0');
  VisitType(type, [&](auto voxel) {
    auto* const voxels = reinterpret_cast<decltype(voxel)*>(bytes.data());
    for (std::size_t n = 0; n < bricks_.size(); ++n) {
      const std::size_t first =
          ((n >> 4) * kGroupEdge * kGroupEdge + (n >> 2 & 3) * kGroupEdge + (n & 3)) * kBrickEdge;
      CopyBrick(*bricks_.at(n), voxels + first);
    }
  });
  return bytes;
}

bool AreAll(std::string_view bytes, LeafType type, float value) {
  return VisitType(type, [&](auto voxel) {
    voxel = static_cast<decltype(voxel)>(value);
    return std::memcmp(bytes.data(), &voxel, sizeof(voxel)) == 0 &&
           std::memcmp(bytes.data(), bytes.data() + sizeof(voxel), bytes.size() - sizeof(voxel)) ==
               0;
  });
}

}  // namespace palpate::web
