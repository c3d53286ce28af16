#include "server/volume/snapshot_builder.h"

#include <map>
#include <utility>
#include <vector>

#include "common/error/error.h"

namespace palpate {
namespace {

using Brick = std::array<float, VolumeSnapshot::kBrickVoxels>;

// What a snapshot points into: the grid's leaves, and one brick per value of
// the constant tiles.
struct BrickOwner {
  openvdb::FloatGrid::ConstPtr grid;
  std::map<float, std::unique_ptr<Brick>> constant_bricks;

  const float* ConstantBrick(float value) {
    std::unique_ptr<Brick>& brick = constant_bricks[value];
    if (!brick) {
      brick = std::make_unique<Brick>();
      brick->fill(value);
    }
    return brick->data();
  }
};

}  // namespace

std::shared_ptr<const VolumeSnapshot> MakeSnapshot(openvdb::FloatGrid::ConstPtr grid,
                                                   const VolumeMetadata& metadata,
                                                   std::uint64_t revision) {
  auto owner = std::make_shared<BrickOwner>();
  owner->grid = grid;
  const Vec3i count(BrickCount(metadata.size.x()), BrickCount(metadata.size.y()),
                    BrickCount(metadata.size.z()));
  std::vector<const float*> bricks;
  bricks.reserve(static_cast<std::size_t>(count.x()) * count.y() * count.z());
  openvdb::FloatGrid::ConstAccessor accessor = grid->getConstAccessor();
  constexpr int kEdge = VolumeSnapshot::kBrickEdge;
  for (int a = 0; a < count.x(); ++a) {
    for (int b = 0; b < count.y(); ++b) {
      for (int c = 0; c < count.z(); ++c) {
        const openvdb::Coord corner(a * kEdge, b * kEdge, c * kEdge);
        const auto* leaf = accessor.probeConstLeaf(corner);
        bricks.push_back(leaf ? leaf->buffer().data()
                              : owner->ConstantBrick(accessor.getValue(corner)));
      }
    }
  }
  const std::uint64_t bytes = grid->memUsage() + bricks.size() * sizeof(const float*) +
                              owner->constant_bricks.size() * sizeof(Brick);
  return std::make_shared<VolumeSnapshot>(metadata, std::move(bricks), std::move(owner), revision,
                                          bytes);
}

void SetValueRange(const openvdb::FloatGrid& grid, VolumeMetadata& metadata) {
  openvdb::FloatGrid::ConstAccessor accessor = grid.getConstAccessor();
  float min = accessor.getValue(openvdb::Coord(0, 0, 0)), max = min;
  for (int i = 0; i < metadata.size.x(); ++i) {
    for (int j = 0; j < metadata.size.y(); ++j) {
      for (int k = 0; k < metadata.size.z(); ++k) {
        const float value = accessor.getValue(openvdb::Coord(i, j, k));
        min = std::min(min, value);
        max = std::max(max, value);
      }
    }
  }
  if (!(min < max)) {
    throw Error(ErrorKind::kInvalidArgument,
                "every voxel has the same value: there is no isosurface to feel");
  }
  metadata.value_min = min;
  metadata.value_max = max;
}

}  // namespace palpate
