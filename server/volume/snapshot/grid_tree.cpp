#include "server/volume/snapshot/grid_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>

#include "server/volume/snapshot/openvdb_grids.h"

namespace palpate {
namespace {

openvdb::Coord ToCoord(const Vec3i& at) { return {at.x(), at.y(), at.z()}; }

// z fastest.
template <class Visit>
void ForEachBrickOf(const Vec3i& count, const Visit& visit) {
  for (int a = 0; a < count.x(); ++a) {
    for (int b = 0; b < count.y(); ++b) {
      for (int c = 0; c < count.z(); ++c) visit(Vec3i(a, b, c));
    }
  }
}

bool HoldsIntegers(const Leaf& leaf) { return leaf.type() != LeafType::kFloat; }

// Converts a float back to the T that it came from.
template <class T>
T As(float value) {
  if constexpr (std::is_same_v<T, bool>) {
    return value != 0.0f;
  } else if constexpr (std::is_integral_v<T>) {
    // The conversion to float may have rounded up, past the greatest T.
    constexpr T kLeast = std::numeric_limits<T>::min(), kGreatest = std::numeric_limits<T>::max();
    if (value >= -static_cast<float>(kLeast)) return kGreatest;
    return value <= static_cast<float>(kLeast) ? kLeast : static_cast<T>(value);
  } else {
    return static_cast<T>(value);
  }
}

template <class Grid>
class TreeMaker {
 public:
  using Tree = typename Grid::TreeType;
  using Value = typename Grid::ValueType;
  using Root = typename Tree::RootNodeType;
  using TopNode = typename Root::ChildNodeType;
  using Node = typename TopNode::ChildNodeType;
  using LeafNode = typename Tree::LeafNodeType;

  TreeMaker(const NextLeaf& next, const VolumeMetadata& metadata)
      : next_(next),
        size_(metadata.size),
        form_(metadata.grid_form.get()),
        first_(form_ ? form_->first : Vec3i::Zero()),
        background_(form_ ? form_->background : static_cast<float>(metadata.Background())),
        grid_(Grid::create(As<Value>(background_))) {}

  typename Grid::Ptr Make() {
    if (form_) PutForm();
    const Vec3i count = (size_.array() + (kBrickEdge - 1)) / kBrickEdge;
    ForEachBrickOf(count, [this](const Vec3i& brick) { PutBrick(brick, next_()); });
    return std::move(grid_);
  }

 private:
  Tree& tree() { return grid_->tree(); }

  void PutForm() {
    for (const Vec3i& first : form_->top_nodes) {
      tree().root().addChild(new TopNode(ToCoord(first), As<Value>(background_), false));
    }
    for (const GridTile& tile : form_->tiles) {
      if (tile.edge != kBrickEdge) PutTile(tile);
    }
    for (const Vec3i& first : form_->nodes) PutNode(first);
    for (const GridTile& tile : form_->tiles) {
      if (tile.edge == kBrickEdge) PutTile(tile);
    }
    for (const GridLeaf& outer : form_->outer_leaves) {
      tree().addLeaf(MadeLeaf(*outer.leaf, outer.first).release());
    }
  }

  void PutTile(const GridTile& tile) {
    const openvdb::Index level = tile.edge == kBrickEdge      ? LeafNode::LEVEL + 1
                                 : tile.edge == kGridNodeEdge ? Node::LEVEL + 1
                                                              : TopNode::LEVEL + 1;
    tree().addTile(level, ToCoord(tile.first), As<Value>(tile.value), tile.is_active);
  }

  void PutNode(const Vec3i& first) {
    auto* const top = tree().root().template probeNode<TopNode>(ToCoord(first));
    if (top) top->addChild(new Node(ToCoord(first), As<Value>(background_), false));
  }

  // If a tile there already has the brick's value and state, leaves the tile.
  void PutBrick(const Vec3i& brick, const Leaf& leaf) {
    const Vec3i first = first_ + kBrickEdge * brick;
    const openvdb::Coord at = ToCoord(first);
    const bool is_whole = form_ || ((brick + Vec3i::Ones()) * kBrickEdge - size_).maxCoeff() <= 0;
    if (leaf.is_constant() && is_whole) {
      const float value = leaf[0];
      // If the volume did not come from a grid, values other than the background are active.
      const bool is_active = form_ ? leaf.IsActive(0) : value != background_;
      const Value is = As<Value>(value);
      const Value there = tree().getValue(at);
      // Compares bits: 0 is not -0.
      if (std::memcmp(&there, &is, sizeof is) == 0 && tree().isValueOn(at) == is_active) return;
      tree().addTile(LeafNode::LEVEL + 1, at, is, is_active);
      return;
    }
    auto node = MadeLeaf(leaf, first);
    if (!form_) {
      Clip(brick, *node);
      if (node->isEmpty()) return;
    }
    tree().addLeaf(node.release());
  }

  std::unique_ptr<LeafNode> MadeLeaf(const Leaf& leaf, const Vec3i& first) {
    leaf.CopyTo(values_.data());
    auto node = std::make_unique<LeafNode>(ToCoord(first), As<Value>(background_), false);
    for (int n = 0; n < kBrickVoxels; ++n) {
      const auto place = static_cast<openvdb::Index>(n);
      node->setValueOnly(place, As<Value>(values_[n]));
      const bool is_active = form_ ? leaf.IsActive(place) : values_[n] != background_;
      if (is_active) node->setValueOn(place);
    }
    return node;
  }

  // Removes voxels beyond the lattice, whatever the bricks hold there.
  void Clip(const Vec3i& brick, LeafNode& node) const {
    const Vec3i end = size_ - kBrickEdge * brick;
    for (int n = 0; n < kBrickVoxels; ++n) {
      if (n >> 6 < end.x() && (n >> 3 & 7) < end.y() && (n & 7) < end.z()) continue;
      node.setValueOff(static_cast<openvdb::Index>(n), As<Value>(background_));
    }
  }

  const NextLeaf& next_;
  const Vec3i size_;
  const GridForm* const form_;
  const Vec3i first_;
  const float background_;
  typename Grid::Ptr grid_;
  Brick values_;
};

}  // namespace

std::string_view GridTypeOf(const BrickDirectory& bricks, const VolumeMetadata& metadata) {
  const std::string_view type = metadata.grid_form ? metadata.grid_form->type : "int32";
  if (type == "float" || type == "double") return type;
  // The greatest integer of the type becomes this number as a float, one more than the integer.
  const float most = type == "int64" ? 0x1p63f : 0x1p31f;
  bool is_integer = true, is_bool = true;
  const Leaf* last = nullptr;
  ForEachBrickOf(bricks.brick_count(), [&](const Vec3i& brick) {
    const Leaf& leaf = *bricks.At(brick);
    if (&leaf == last || !is_integer) return;
    last = &leaf;
    const Brick values = leaf.Floats();
    is_integer =
        HoldsIntegers(leaf) || std::all_of(values.begin(), values.end(), [most](float value) {
          return std::trunc(value) == value && std::abs(value) <= most;
        });
    is_bool = is_bool && std::all_of(values.begin(), values.end(),
                                     [](float value) { return value == 0.0f || value == 1.0f; });
  });
  if (!metadata.grid_form) {
    // Floats that happen to be integers stay floats.
    is_integer = is_integer && metadata.original_type.find("int") != std::string::npos;
  }
  if (type == "bool") return is_bool ? type : is_integer ? "int32" : "float";
  return is_integer ? type : "float";
}

NextLeaf LeavesOf(const BrickDirectory& bricks) {
  return [&bricks, number = std::uint64_t{0}]() mutable -> const Leaf& {
    return *bricks.At(bricks.BrickOf(number++));
  };
}

template <class Grid>
std::shared_ptr<Grid> MakeGrid(const NextLeaf& next, const VolumeMetadata& metadata) {
  return TreeMaker<Grid>(next, metadata).Make();
}

template std::shared_ptr<openvdb::FloatGrid> MakeGrid(const NextLeaf&, const VolumeMetadata&);
template std::shared_ptr<openvdb::DoubleGrid> MakeGrid(const NextLeaf&, const VolumeMetadata&);
template std::shared_ptr<openvdb::Int32Grid> MakeGrid(const NextLeaf&, const VolumeMetadata&);
template std::shared_ptr<openvdb::Int64Grid> MakeGrid(const NextLeaf&, const VolumeMetadata&);
template std::shared_ptr<openvdb::BoolGrid> MakeGrid(const NextLeaf&, const VolumeMetadata&);

}  // namespace palpate
