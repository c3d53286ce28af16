#include "server/volume/snapshot/snapshot_builder.h"

#include <algorithm>
#include <map>
#include <utility>

#include "common/error/error.h"
#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

using Node = openvdb::FloatTree::LeafNodeType;

openvdb::Coord FirstVoxelOf(const Vec3i& brick) {
  return {brick.x() * kBrickEdge, brick.y() * kBrickEdge, brick.z() * kBrickEdge};
}

// The leaves of constant tiles: one per value.
class ConstantLeaves {
 public:
  const LeafPtr& Of(float value) {
    LeafPtr& leaf = leaves_[value];
    if (!leaf) leaf = Leaf::Constant(LeafType::kFloat, value);
    return leaf;
  }

 private:
  std::map<float, LeafPtr> leaves_;
};

}  // namespace

std::shared_ptr<const VolumeSnapshot> MakeSnapshot(openvdb::FloatGrid::ConstPtr grid,
                                                   const VolumeMetadata& metadata,
                                                   std::uint64_t revision) {
  const openvdb::FloatGrid::ConstAccessor accessor = grid->getConstAccessor();
  ConstantLeaves constants;
  const BrickDirectory bricks(metadata.size, [&](const Vec3i& brick) {
    const openvdb::Coord corner = FirstVoxelOf(brick);
    const Node* node = accessor.probeConstLeaf(corner);
    return node ? Leaf::Take(std::make_unique<Node>(*node))
                : constants.Of(accessor.getValue(corner));
  });
  return std::make_shared<VolumeSnapshot>(metadata, bricks.AllChangedAt(revision), revision,
                                          revision);
}

BrickDirectory TakeBricks(openvdb::FloatGrid& grid, const Vec3i& size_voxels) {
  openvdb::FloatTree& tree = grid.tree();
  ConstantLeaves constants;
  return {size_voxels, [&](const Vec3i& brick) {
            const openvdb::Coord corner = FirstVoxelOf(brick);
            std::unique_ptr<Node> node(tree.stealNode<Node>(corner, tree.background(), false));
            return node ? Leaf::Take(std::move(node)) : constants.Of(tree.getValue(corner));
          }};
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
