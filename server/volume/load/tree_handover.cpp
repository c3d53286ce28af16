#include "server/volume/load/tree_handover.h"

#include <openvdb/tree/LeafNode.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/volume/load/handover.h"
#include "server/volume/snapshot/grid_tree.h"

namespace palpate {
namespace {

using Place = std::array<std::int32_t, 3>;

Vec3i ToVec(const std::int32_t (&place)[3]) { return {place[0], place[1], place[2]}; }
Vec3i ToVec(const Place& place) { return {place[0], place[1], place[2]}; }

// The first place of the cube around a place. The cube's edge is a power of two.
Vec3i CubeOf(const Vec3i& place, int edge) {
  return place.unaryExpr([edge](int n) { return n & -edge; });
}

bool IsCube(const Vec3i& first, int edge) { return CubeOf(first, edge) == first; }

struct HashOfPlace {
  std::size_t operator()(const Vec3i& place) const {
    // Random in each process, so that no file can choose places that collide.
    static const std::uint64_t seed =
        std::uint64_t{std::random_device()()} << 32 | std::random_device()();
    std::uint64_t hash = seed;
    for (const int n : place) {
      hash = (hash ^ static_cast<std::uint32_t>(n)) * 0x9E3779B97F4A7C15ull;
      hash ^= hash >> 32;
    }
    return hash;
  }
};

// A region of one value. Its leaf is made when the lattice first needs it.
struct Tile {
  float value = 0.0f;
  bool is_active = false;
  LeafPtr leaf{};
};

template <class Value>
using ByPlace = std::unordered_map<Vec3i, Value, HashOfPlace>;
using Places = std::unordered_set<Vec3i, HashOfPlace>;

// The positions of the parts in the file.
struct Parts {
  std::int64_t entries, top_nodes, tiles, nodes, leaf_places, leaves, end;
};

constexpr std::int64_t kStateBytes = kBrickVoxels / 8;
constexpr std::uint64_t kMostNodes = 1 << 16;
// Above this number of values, each place gets its own leaf.
constexpr std::size_t kMostSharedTiles = 1 << 14;
constexpr std::size_t kMostTiles = 1 << 20;
// The most memory that a tile takes in all lists and maps.
constexpr std::uint64_t kTileBytes = 128;
// Bricks between two reports of progress.
constexpr std::uint64_t kBricksAtOnce = 1 << 14;

Parts PartsOf(const HandoverTree& tree, LeafType type, std::int64_t max_voxels) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 32;
  if (tree.entry_bytes > kMostEntryBytes || tree.leaves > kMost) {
    RefuseHandover("more parts than a tree has");
  }
  if (tree.leaves * kBrickVoxels > static_cast<std::uint64_t>(max_voxels) ||
      tree.nodes > kMostNodes || tree.top_nodes > kMostNodes || tree.tiles > kMostTiles) {
    throw Error(ErrorKind::kTooLarge, "there are more than " + std::to_string(max_voxels) +
                                          " voxels, or they lie too far apart; crop or resample "
                                          "the volume");
  }
  const auto bytes = [](std::uint64_t count, std::size_t size) {
    return static_cast<std::int64_t>(count * size);
  };
  Parts parts{};
  parts.entries = kHandoverVoxels;
  parts.top_nodes = parts.entries + bytes(tree.entry_bytes, 1);
  parts.tiles = parts.top_nodes + bytes(tree.top_nodes, sizeof(Place));
  parts.nodes = parts.tiles + bytes(tree.tiles, sizeof(HandoverTile));
  parts.leaf_places = parts.nodes + bytes(tree.nodes, sizeof(HandoverNode));
  parts.leaves = parts.leaf_places + bytes(tree.leaves, sizeof(Place));
  parts.end = parts.leaves + bytes(tree.leaves, kStateBytes + kBrickVoxels * VoxelBytes(type));
  return parts;
}

template <class Item>
std::vector<Item> ReadItems(int fd, std::int64_t offset, std::uint64_t count) {
  std::vector<Item> items(count);
  ReadHandoverAt(fd, items.data(), count * sizeof(Item), offset);
  return items;
}

// Refuses an entry that OpenVDB would not save.
void CheckEntry(const GridEntry& entry) {
  const bool is_odd_flag =
      entry.type->name == "bool" && static_cast<unsigned char>(entry.bytes[0]) > 1;
  if (entry.name.empty() || entry.name.starts_with("palpate_") || is_odd_flag) {
    RefuseHandover("metadata that a grid cannot have");
  }
}

std::vector<GridEntry> ReadEntries(const std::vector<char>& bytes) {
  std::vector<GridEntry> entries;
  for (std::size_t at = 0; at < bytes.size();) {
    HandoverEntry entry;
    if (bytes.size() - at < sizeof entry) RefuseHandover("cut metadata");
    std::memcpy(&entry, bytes.data() + at, sizeof entry);
    at += sizeof entry;
    if (entry.type >= std::size(kGridEntryTypes) || entry.name_bytes > bytes.size() - at ||
        entry.value_bytes > bytes.size() - at - entry.name_bytes) {
      RefuseHandover("cut metadata");
    }
    const GridEntryType& type = kGridEntryTypes[entry.type];
    if (type.bytes != 0 && type.bytes != entry.value_bytes)
      RefuseHandover("metadata of an unknown type");
    const char* const name = bytes.data() + at;
    const char* const value = name + entry.name_bytes;
    entries.push_back({{name, value}, &type, {value, value + entry.value_bytes}});
    CheckEntry(entries.back());
    at += std::size_t{entry.name_bytes} + entry.value_bytes;
  }
  return entries;
}

class TreeTaker {
 public:
  TreeTaker(int fd, const HandoverHeader& header, VolumeMetadata metadata,
            const TakeOptions& options)
      : fd_(fd),
        tree_(header.tree),
        type_(kLeafTypes[header.type]),
        metadata_(std::move(metadata)),
        options_(options) {}

  LoadedVolume Take() {
    CheckLattice();
    parts_ = PartsOf(tree_, type_, options_.max_voxels);
    struct stat status {};
    if (fstat(fd_, &status) != 0) FailHandover("cannot look at the hand-over");
    if (status.st_size != parts_.end) RefuseHandover("not as many parts as stated");
    TellMemory();
    ReadForm();
    background_ = {form_.background, false};
    CountConstant(form_.background, false);
    ReadTiles();
    ReadNodes();
    PlaceLeaves();
    TellMemory();  // now with the tiles
    BrickDirectory bricks(metadata_.size, [this](const Vec3i& brick) { return LeafAt(brick); });
    TakeOuterLeaves();
    metadata_.value_min = least_;
    metadata_.value_max = greatest_;
    CheckVolumeMetadata(metadata_);
    metadata_.grid_form = std::make_shared<const GridForm>(std::move(form_));
    return {std::move(metadata_), std::move(bricks)};
  }

 private:
  void CheckLattice() {
    form_.first = ToVec(tree_.first);
    const auto first = form_.first.cast<std::int64_t>().eval();
    const auto size = metadata_.size.cast<std::int64_t>().eval();
    constexpr std::int64_t kFarthest = std::int64_t{1} << 30;
    if (!IsCube(form_.first, kBrickEdge) || size.minCoeff() < 2 || first.minCoeff() < -kFarthest ||
        (first + size).maxCoeff() > kFarthest) {
      RefuseHandover("an invalid lattice");
    }
    std::int64_t voxels = 0;
    if (__builtin_mul_overflow(size.x() * size.y(), size.z(), &voxels) ||
        voxels > kMostLatticeVoxels) {
      throw Error(ErrorKind::kTooLarge, "its active voxels lie in a box of more than " +
                                            std::to_string(kMostLatticeVoxels) +
                                            " voxels; crop or resample the volume");
    }
    if (tree_.grid_type >= std::size(kGridTypes) || tree_.map > std::size(kGridMaps) ||
        !IsValue(tree_.background)) {
      RefuseHandover("a grid of an unknown type");
    }
  }

  void ReadForm() {
    form_.type = kGridTypes[tree_.grid_type];
    form_.background = tree_.background;
    if (tree_.map < std::size(kGridMaps)) form_.map = kGridMaps[tree_.map];
    std::copy(std::begin(tree_.matrix), std::end(tree_.matrix), form_.matrix.begin());
    if (!std::all_of(form_.matrix.begin(), form_.matrix.end(),
                     [](double number) { return std::isfinite(number); })) {
      RefuseHandover("a transform that is not finite");
    }
    CheckMap();
    form_.entries = ReadEntries(ReadItems<char>(fd_, parts_.entries, tree_.entry_bytes));
    std::set<std::string_view> names;
    for (const GridEntry& entry : form_.entries) {
      if (!names.insert(entry.name).second) RefuseHandover("two entries of one name");
    }
    for (const Place& place : ReadItems<Place>(fd_, parts_.top_nodes, tree_.top_nodes)) {
      if (!IsCube(ToVec(place), kGridTopNodeEdge) || !top_nodes_.insert(ToVec(place)).second) {
        RefuseHandover("a node that is out of place");
      }
      form_.top_nodes.push_back(ToVec(place));
    }
  }

  // Checks that the map agrees with the metadata.
  void CheckMap() const {
    if (form_.map.empty()) return;
    bool is_same = form_.matrix[3] == 0.0 && form_.matrix[7] == 0.0 && form_.matrix[11] == 0.0 &&
                   form_.matrix[15] == 1.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double spacing_mm = metadata_.spacing_mm[axis];
      for (int row = 0; row < 3; ++row) {
        const double is = form_.matrix[static_cast<std::size_t>(4 * axis + row)];
        const double stated = metadata_.direction(row, axis) * spacing_mm;
        is_same = is_same && std::abs(is - stated) <= 1e-6 * spacing_mm;
      }
    }
    if (!is_same) RefuseHandover("two transforms");
  }

  void ReadTiles() {
    for (const HandoverTile& tile : ReadItems<HandoverTile>(fd_, parts_.tiles, tree_.tiles)) {
      const Vec3i first = ToVec(tile.first);
      const bool is_top = tile.edge == kGridTopNodeEdge;
      if ((!is_top && tile.edge != kGridNodeEdge) || !IsCube(first, tile.edge) ||
          top_nodes_.contains(CubeOf(first, kGridTopNodeEdge)) == is_top || !IsValue(tile.value)) {
        RefuseHandover("a tile that is out of place");
      }
      const bool is_active = tile.is_active != 0;
      if (!(is_top ? top_tiles_ : tiles_).emplace(first, Tile{tile.value, is_active}).second) {
        RefuseHandover("two tiles in one place");
      }
      if (MeetsLattice(first, tile.edge)) CountConstant(tile.value, is_active);
      form_.tiles.push_back({first, tile.edge, tile.value, tile.is_active != 0});
    }
  }

  void ReadNodes() {
    std::uint64_t leaves = 0;
    for (std::uint64_t n = 0; n < tree_.nodes; ++n) {
      const auto node = std::make_shared<HandoverNode>();
      ReadHandoverAt(fd_, node.get(), sizeof *node,
                     parts_.nodes + static_cast<std::int64_t>(n * sizeof *node));
      const Vec3i first = ToVec(node->first);
      if (!IsCube(first, kGridNodeEdge) || tiles_.contains(first) ||
          !top_nodes_.contains(CubeOf(first, kGridTopNodeEdge)) ||
          !nodes_.emplace(first, node).second) {
        RefuseHandover("a node that is out of place");
      }
      form_.nodes.push_back(first);
      for (const std::uint64_t word : node->is_leaf) leaves += std::popcount(word);
      TakeTilesOf(first, *node);
    }
    if (leaves != tree_.leaves) RefuseHandover("other leaves than the nodes have");
  }

  // Checks the tiles of a node. Counts constants for tiles within the lattice, and keeps tiles
  // beyond the lattice in the form.
  void TakeTilesOf(const Vec3i& first, const HandoverNode& node) {
    for (int place = 0; place < HandoverNode::kPlaces; ++place) {
      if (Bit(node.is_leaf, place)) continue;
      const float value = node.values[place];
      const bool is_active = Bit(node.is_active, place);
      if (!IsValue(value)) RefuseHandover("a tile of another type");
      const Vec3i voxel = first + kBrickEdge * Vec3i(place >> 8, place >> 4 & 15, place & 15);
      if (IsInLattice(voxel)) {
        CountConstant(value, is_active);
        continue;
      }
      if (!is_active && value == form_.background) continue;
      if (form_.tiles.size() == kMostTiles) {
        throw Error(ErrorKind::kTooLarge,
                    "there are too many tiles beyond its active voxels; crop "
                    "the volume");
      }
      form_.tiles.push_back({voxel, kBrickEdge, value, is_active});
    }
  }

  void PlaceLeaves() {
    const auto places = ReadItems<Place>(fd_, parts_.leaf_places, tree_.leaves);
    leaves_.reserve(places.size());
    for (std::size_t n = 0; n < places.size(); ++n) {
      const Vec3i first = ToVec(places[n]);
      const auto node = nodes_.find(CubeOf(first, kGridNodeEdge));
      if (!IsCube(first, kBrickEdge) || node == nodes_.end() ||
          !Bit(node->second->is_leaf, PlaceInNode(first)) || !leaves_.emplace(first, n).second) {
        RefuseHandover("a leaf that is out of place");
      }
    }
  }

  void TellMemory() const {
    if (!options_.on_size) return;
    const std::uint64_t directory = BrickDirectory::MemoryBytes(metadata_.size, type_) -
                                    static_cast<std::uint64_t>(Bricks()) * Leaf::Bytes(type_);
    options_.on_size(
        metadata_.size,
        {.volume_bytes =
             (tree_.leaves + constants_.size() + own_constants_) * Leaf::Bytes(type_) + directory,
         .passing_bytes = static_cast<std::uint64_t>(parts_.end) +
                          tree_.nodes * sizeof(HandoverNode) +
                          (tree_.tiles + form_.tiles.size()) * kTileBytes});
  }
  std::int64_t Bricks() const {
    return ((metadata_.size.array() + (kBrickEdge - 1)) / kBrickEdge).cast<std::int64_t>().prod();
  }

  LeafPtr LeafAt(const Vec3i& brick) {
    if (bricks_++ % kBricksAtOnce == 0 && options_.progress) {
      options_.progress(static_cast<double>(bricks_ - 1) / static_cast<double>(Bricks()));
    }
    const Vec3i first = form_.first + kBrickEdge * brick;
    const Vec3i region = CubeOf(first, kGridNodeEdge);
    if (region != region_ || !region_known_) EnterRegion(region);
    if (!node_) {
      if (!tile_->leaf) tile_->leaf = Constant(tile_->value, tile_->is_active);
      return Counted(tile_->leaf, brick);
    }
    const int place = PlaceInNode(first);
    if (Bit(node_->is_leaf, place)) return Counted(ReadLeaf(first), brick);
    return Counted(Constant(node_->values[place], Bit(node_->is_active, place)), brick);
  }

  void EnterRegion(const Vec3i& region) {
    region_ = region;
    region_known_ = true;
    const auto node = nodes_.find(region);
    node_ = node == nodes_.end() ? nullptr : node->second.get();
    const auto tile = tiles_.find(region);
    const auto top = top_tiles_.find(CubeOf(region, kGridTopNodeEdge));
    tile_ = tile != tiles_.end()      ? &tile->second
            : top != top_tiles_.end() ? &top->second
                                      : &background_;
  }

  LeafPtr ReadLeaf(const Vec3i& first) {
    const auto at = leaves_.find(first);
    if (at == leaves_.end()) RefuseHandover("a leaf that is missing");
    return VisitType(type_, [&](auto voxel) {
      using T = decltype(voxel);
      struct {
        std::uint64_t states[kBrickVoxels / 64];
        T values[kBrickVoxels];
      } record;
      ReadHandoverAt(fd_, &record, sizeof record,
                     parts_.leaves + static_cast<std::int64_t>(at->second * sizeof record));
      auto node = std::make_unique<Leaf::Node<T>>(openvdb::Coord(0, 0, 0), T(), false);
      if constexpr (std::is_same_v<T, float>) {
        if (!std::all_of(std::begin(record.values), std::end(record.values),
                         [](float value) { return std::isfinite(value); })) {
          RefuseHandover("voxels that are no finite numbers");
        }
      }
      std::copy(std::begin(record.values), std::end(record.values), node->buffer().data());
      openvdb::util::NodeMask<3> states;
      for (openvdb::Index n = 0; n < std::size(record.states); ++n) {
        states.template getWord<openvdb::Index64>(n) = record.states[n];
      }
      node->setValueMask(states);
      return Leaf::Take(std::move(node));
    });
  }

  // Widens the range by the leaf's voxels within the lattice.
  const LeafPtr& Counted(const LeafPtr& leaf, const Vec3i& brick) {
    kept_ = leaf;
    if (leaf->is_constant()) {
      Widen((*leaf)[0]);
      return kept_;
    }
    const Vec3i end = (metadata_.size - kBrickEdge * brick).cwiseMin(kBrickEdge);
    leaf->CopyTo(values_.data());
    for (int i = 0; i < end.x(); ++i) {
      for (int j = 0; j < end.y(); ++j) {
        for (int k = 0; k < end.z(); ++k) Widen(values_[VoxelInBrick(i, j, k)]);
      }
    }
    return kept_;
  }
  void Widen(float value) {
    least_ = std::min(least_, static_cast<double>(value));
    greatest_ = std::max(greatest_, static_cast<double>(value));
  }

  void TakeOuterLeaves() {
    for (const auto& [first, n] : leaves_) {
      if (!IsInLattice(first)) form_.outer_leaves.push_back({first, ReadLeaf(first)});
    }
  }

  // Counts the leaf that a constant will need.
  void CountConstant(float value, bool is_active) {
    const auto key = KeyOf(value, is_active);
    if (constants_.contains(key)) return;
    if (constants_.size() == kMostSharedTiles) {
      ++own_constants_;
    } else {
      constants_.emplace(key, nullptr);
    }
  }
  LeafPtr Constant(float value, bool is_active) {
    const auto shared = constants_.find(KeyOf(value, is_active));
    if (shared == constants_.end()) return Leaf::Constant(type_, value, is_active);
    if (!shared->second) shared->second = Leaf::Constant(type_, value, is_active);
    return shared->second;
  }
  static std::pair<std::uint32_t, bool> KeyOf(float value, bool is_active) {
    return {std::bit_cast<std::uint32_t>(value), is_active};
  }
  bool IsValue(float value) const { return std::isfinite(value) && Holds(type_, value + 0.0f); }
  bool IsInLattice(const Vec3i& voxel) const {
    const auto at = (voxel.cast<std::int64_t>() - form_.first.cast<std::int64_t>()).eval();
    return at.minCoeff() >= 0 && (at.array() < metadata_.size.cast<std::int64_t>().array()).all();
  }
  bool MeetsLattice(const Vec3i& first, int edge) const {
    const auto from = (first.cast<std::int64_t>() - form_.first.cast<std::int64_t>()).eval();
    return (from.array() + edge > 0).all() &&
           (from.array() < metadata_.size.cast<std::int64_t>().array()).all();
  }
  static int PlaceInNode(const Vec3i& voxel) {
    const Vec3i at = (voxel - CubeOf(voxel, kGridNodeEdge)) / kBrickEdge;
    return at.x() << 8 | at.y() << 4 | at.z();
  }
  static bool Bit(const std::uint64_t* words, int n) { return words[n >> 6] >> (n & 63) & 1; }

  const int fd_;
  const HandoverTree& tree_;
  const LeafType type_;
  VolumeMetadata metadata_;
  const TakeOptions& options_;
  Parts parts_{};
  GridForm form_;
  Places top_nodes_;
  ByPlace<Tile> top_tiles_, tiles_;
  ByPlace<std::shared_ptr<HandoverNode>> nodes_;
  ByPlace<std::uint64_t> leaves_;  // the leaves' numbers
  std::map<std::pair<std::uint32_t, bool>, LeafPtr> constants_;
  // The region of the last brick.
  Vec3i region_ = Vec3i::Zero();
  bool region_known_ = false;
  const HandoverNode* node_ = nullptr;
  Tile* tile_ = nullptr;
  Tile background_;
  LeafPtr kept_;
  std::uint64_t own_constants_ = 0;
  std::uint64_t bricks_ = 0;
  Brick values_;
  double least_ = std::numeric_limits<double>::infinity(), greatest_ = -least_;
};

}  // namespace

LoadedVolume TakeTree(int fd, const HandoverHeader& header, VolumeMetadata metadata,
                      const TakeOptions& options) {
  return TreeTaker(fd, header, std::move(metadata), options).Take();
}

}  // namespace palpate
