#include "server/import/tree_writer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "common/error/text.h"
#include "server/import/image_header.h"
#include "server/volume/load/handover.h"

namespace palpate {
namespace {

using Place = std::array<std::int32_t, 3>;

Place PlaceOf(const openvdb::Coord& at) { return {at.x(), at.y(), at.z()}; }

// Collects facts about all values: the smallest type that holds them, and the least value.
template <class Value>
class Survey {
 public:
  void Add(const Value& value) {
    const auto is = static_cast<float>(value);
    if (!std::isfinite(is)) {
      ++odd_;
      return;
    }
    least_ = std::min(least_, is);
    if (!IsExact(value, is)) ++rounded_;
    // Other types than float may hold values that no float holds.
    if constexpr (!std::is_same_v<Value, float>) {
      // The next type may not hold the least value that the previous type held.
      while (type_ != LeafType::kFloat &&
             !(Holds(type_, is) && Holds(type_, least_) && IsExact(value, is))) {
        type_ = static_cast<LeafType>(static_cast<int>(type_) + 1);
      }
    }
  }
  LeafType type() const { return std::is_same_v<Value, float> ? LeafType::kFloat : type_; }
  std::int64_t odd() const { return odd_; }
  std::int64_t rounded() const { return rounded_; }
  float least() const { return least_; }

 private:
  static bool IsExact(const Value& value, float is) {
    return static_cast<double>(value) == static_cast<double>(is);
  }

  LeafType type_ = kLeafTypes[0];
  float least_ = std::numeric_limits<float>::infinity();
  std::int64_t odd_ = 0;
  std::int64_t rounded_ = 0;
};

// Buffers consecutive writes.
class Appender {
 public:
  explicit Appender(int fd, std::int64_t offset) : fd_(fd), offset_(offset) {}
  void Append(const void* data, std::size_t size) {
    const char* const bytes = static_cast<const char*>(data);
    buffer_.insert(buffer_.end(), bytes, bytes + size);
    if (buffer_.size() >= kBuffer) Flush();
  }
  void Flush() {
    WriteHandoverAt(fd_, buffer_.data(), buffer_.size(), offset_);
    offset_ += static_cast<std::int64_t>(buffer_.size());
    buffer_.clear();
  }

 private:
  static constexpr std::size_t kBuffer = std::size_t{1} << 20;
  const int fd_;
  std::int64_t offset_;
  std::vector<char> buffer_;
};

template <class Tree>
class TreeWriter {
 public:
  using Value = typename Tree::ValueType;
  using Root = typename Tree::RootNodeType;
  using TopNode = typename Root::ChildNodeType;
  using Node = typename TopNode::ChildNodeType;
  using LeafNode = typename Tree::LeafNodeType;

  TreeWriter(int fd, const Tree& tree, Reporter* reporter)
      : out_(fd, kHandoverVoxels), fd_(fd), tree_(tree), reporter_(reporter) {}

  void Write(const VolumeMetadata& metadata, const GridForm& form) {
    Look();
    HandoverHeader header = MakeHandoverHeader(metadata, survey_.type());
    header.form = static_cast<std::uint32_t>(HandoverForm::kTree);
    FillHeader(form, header.tree);
    WriteHandoverAt(fd_, &header, sizeof header, 0);
    WriteParts(form);
    out_.Flush();
  }

 private:
  // Visits the whole tree: collects the nodes and surveys the values.
  void Look() {
    survey_.Add(tree_.background());
    for (auto tile = tree_.root().cbeginValueAll(); tile; ++tile) survey_.Add(tile.getValue());
    for (auto top = tree_.root().cbeginChildOn(); top; ++top) {
      top_nodes_.push_back(PlaceOf(top->origin()));
      for (auto tile = top->cbeginValueAll(); tile; ++tile) survey_.Add(tile.getValue());
      for (auto node = top->cbeginChildOn(); node; ++node) Look(*node);
    }
    if (survey_.rounded() > 0) {
      reporter_->Warn(std::to_string(survey_.rounded()) +
                      " voxels are rounded to 32 bit floats, and so they are saved");
    }
    if (survey_.odd() == 0) return;
    if (!std::isfinite(survey_.least())) {
      Refuse("no voxel is a finite number of float range; there is nothing to feel");
    }
    reporter_->Warn(std::to_string(survey_.odd()) +
                    " voxels are not finite numbers of float range; they got the least "
                    "value, " +
                    NumberText(survey_.least()));
  }
  void Look(const Node& node) {
    nodes_.push_back(&node);
    for (auto tile = node.cbeginValueAll(); tile; ++tile) survey_.Add(tile.getValue());
    for (auto leaf = node.cbeginChildOn(); leaf; ++leaf) {
      leaves_.push_back(&*leaf);
      for (openvdb::Index n = 0; n < LeafNode::SIZE; ++n) survey_.Add(leaf->getValue(n));
    }
  }

  void FillHeader(const GridForm& form, HandoverTree& tree) {
    FindTiles();
    const auto number = [](const auto& list, std::string_view item) {
      return static_cast<std::uint32_t>(std::find(std::begin(list), std::end(list), item) -
                                        std::begin(list));
    };
    for (int axis = 0; axis < 3; ++axis) tree.first[axis] = form.first[axis];
    tree.background = ToFloat(tree_.background());
    tree.grid_type = number(kGridTypes, form.type);
    tree.map = number(kGridMaps, form.map);
    std::copy(form.matrix.begin(), form.matrix.end(), std::begin(tree.matrix));
    for (const GridEntry& entry : form.entries) {
      tree.entry_bytes += sizeof(HandoverEntry) + entry.name.size() + entry.bytes.size();
    }
    tree.top_nodes = top_nodes_.size();
    tree.tiles = tiles_.size();
    tree.nodes = nodes_.size();
    tree.leaves = leaves_.size();
  }

  void FindTiles() {
    for (auto tile = tree_.root().cbeginValueAll(); tile; ++tile) {
      Add(tile.getCoord(), kGridTopNodeEdge, tile.getValue(), tile.isValueOn());
    }
    for (auto top = tree_.root().cbeginChildOn(); top; ++top) {
      for (auto tile = top->cbeginValueAll(); tile; ++tile) {
        Add(tile.getCoord(), kGridNodeEdge, tile.getValue(), tile.isValueOn());
      }
    }
  }
  void Add(const openvdb::Coord& first, int edge, const Value& value, bool is_active) {
    if (!is_active && value == tree_.background() && edge != kGridTopNodeEdge) return;
    HandoverTile tile{};
    for (int axis = 0; axis < 3; ++axis) tile.first[axis] = first[axis];
    tile.edge = edge;
    tile.value = ToFloat(value);
    tile.is_active = is_active;
    tiles_.push_back(tile);
  }

  void WriteParts(const GridForm& form) {
    for (const GridEntry& entry : form.entries) {
      const HandoverEntry head{static_cast<std::uint32_t>(entry.type - kGridEntryTypes),
                               static_cast<std::uint32_t>(entry.name.size()),
                               static_cast<std::uint32_t>(entry.bytes.size())};
      out_.Append(&head, sizeof head);
      out_.Append(entry.name.data(), entry.name.size());
      out_.Append(entry.bytes.data(), entry.bytes.size());
    }
    out_.Append(top_nodes_.data(), top_nodes_.size() * sizeof(Place));
    out_.Append(tiles_.data(), tiles_.size() * sizeof(HandoverTile));
    for (const Node* node : nodes_) WriteNode(*node);
    for (const LeafNode* leaf : leaves_) {
      const Place place = PlaceOf(leaf->origin());
      out_.Append(&place, sizeof place);
    }
    VisitType(survey_.type(), [this](auto voxel) {
      for (const LeafNode* leaf : leaves_) WriteLeaf<decltype(voxel)>(*leaf);
    });
  }

  void WriteNode(const Node& node) {
    HandoverNode out{};
    const Place first = PlaceOf(node.origin());
    std::copy(first.begin(), first.end(), out.first);
    const auto set = [](std::uint64_t* words, openvdb::Index n) {
      words[n >> 6] |= std::uint64_t{1} << (n & 63);
    };
    for (auto leaf = node.cbeginChildOn(); leaf; ++leaf) set(out.is_leaf, leaf.pos());
    for (auto tile = node.cbeginValueAll(); tile; ++tile) {
      out.values[tile.pos()] = ToFloat(tile.getValue());
      if (tile.isValueOn()) set(out.is_active, tile.pos());
    }
    out_.Append(&out, sizeof out);
  }

  template <class T>
  void WriteLeaf(const LeafNode& leaf) {
    struct {
      std::uint64_t states[kBrickVoxels / 64];
      T values[kBrickVoxels];
    } out;
    for (openvdb::Index n = 0; n < std::size(out.states); ++n) {
      out.states[n] = leaf.getValueMask().template getWord<openvdb::Index64>(n);
    }
    for (openvdb::Index n = 0; n < LeafNode::SIZE; ++n) {
      out.values[n] = static_cast<T>(ToFloat(leaf.getValue(n)));
    }
    out_.Append(&out, sizeof out);
  }

  float ToFloat(const Value& value) const {
    const auto is = static_cast<float>(value);
    return std::isfinite(is) ? is : survey_.least();
  }

  Appender out_;
  const int fd_;
  const Tree& tree_;
  Reporter* const reporter_;
  Survey<Value> survey_;
  std::vector<Place> top_nodes_;
  std::vector<HandoverTile> tiles_;
  std::vector<const Node*> nodes_;
  std::vector<const LeafNode*> leaves_;
};

}  // namespace

template <class Tree>
void WriteTree(int fd, const Tree& tree, const VolumeMetadata& metadata, const GridForm& form,
               Reporter* reporter) {
  TreeWriter<Tree>(fd, tree, reporter).Write(metadata, form);
}

template void WriteTree(int, const openvdb::FloatTree&, const VolumeMetadata&, const GridForm&,
                        Reporter*);
template void WriteTree(int, const openvdb::DoubleTree&, const VolumeMetadata&, const GridForm&,
                        Reporter*);
template void WriteTree(int, const openvdb::Int32Tree&, const VolumeMetadata&, const GridForm&,
                        Reporter*);
template void WriteTree(int, const openvdb::Int64Tree&, const VolumeMetadata&, const GridForm&,
                        Reporter*);
template void WriteTree(int, const openvdb::BoolTree&, const VolumeMetadata&, const GridForm&,
                        Reporter*);

}  // namespace palpate
