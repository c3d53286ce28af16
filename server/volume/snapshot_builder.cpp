#include "server/volume/snapshot_builder.h"

#include <openvdb/openvdb.h>

#include <algorithm>
#include <map>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

using Node = openvdb::FloatTree::LeafNodeType;

openvdb::Coord CornerOf(const Vec3i& brick) {
  return {brick.x() * kBrickEdge, brick.y() * kBrickEdge, brick.z() * kBrickEdge};
}

// Those of constant tiles: one per value.
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
    const openvdb::Coord corner = CornerOf(brick);
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
            const openvdb::Coord corner = CornerOf(brick);
            std::unique_ptr<Node> node(tree.stealNode<Node>(corner, tree.background(), false));
            return node ? Leaf::Take(std::move(node)) : constants.Of(tree.getValue(corner));
          }};
}

openvdb::FloatGrid::Ptr MakeGrid(const VolumeSnapshot& volume) {
  const auto background = static_cast<float>(volume.metadata().value_min);
  const openvdb::FloatGrid::Ptr grid = openvdb::FloatGrid::create(background);
  const BrickDirectory& bricks = volume.bricks();
  for (std::uint64_t number = 0, end = bricks.brick_count().cast<std::int64_t>().prod();
       number < end; ++number) {
    const Vec3i brick = bricks.BrickOf(number);
    const Brick values = bricks.At(brick)->Floats();
    if (std::all_of(values.begin(), values.end(), [&](float v) { return v == background; })) {
      continue;
    }
    auto node = std::make_unique<Node>(CornerOf(brick), background, false);
    // The grid has nothing beyond the lattice, whatever bricks hold there.
    const Vec3i last = volume.size() - Vec3i::Ones() - brick * kBrickEdge;
    for (int n = 0; n < kBrickVoxels; ++n) {
      const bool inside = n >> 6 <= last.x() && (n >> 3 & 7) <= last.y() && (n & 7) <= last.z();
      if (inside && values[n] != background) {
        node->setValueOn(static_cast<openvdb::Index>(n), values[n]);
      }
    }
    grid->tree().addLeaf(node.release());
  }
  return grid;
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
