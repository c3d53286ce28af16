#include <algorithm>
#include <cstring>
#include <functional>
#include <map>
#include <random>

#include "tests/support/vdb_tool.h"

namespace palpate::vdb_tool {
namespace {

using openvdb::FloatGrid;
using openvdb::FloatTree;

FloatTree::LeafNodeType& SomeLeaf(FloatGrid& grid) {
  const auto leaf = grid.tree().beginLeaf();
  if (!leaf) throw Failure("there is no leaf");
  return *leaf;
}

// Of the last voxel that is so: the first is where everything else begins, too.
template <class Matches>
openvdb::Index SomeVoxel(Matches matches) {
  for (openvdb::Index n = FloatTree::LeafNodeType::SIZE; n-- > 0;) {
    if (matches(n)) return n;
  }
  throw Failure("the first leaf has no such voxel");
}

void ChangeValue(FloatGrid& grid, bool active) {
  auto& leaf = SomeLeaf(grid);
  const auto n = SomeVoxel([&](auto v) { return leaf.isValueOn(v) == active; });
  // The next float: the least change that there is.
  leaf.setValueOnly(n, std::nextafter(leaf.getValue(n), 1e30f));
}

void ChangeState(FloatGrid& grid) {
  auto& leaf = SomeLeaf(grid);
  const auto n = SomeVoxel([&](auto v) { return leaf.isValueOn(v); });
  leaf.setActiveState(n, false);
}

// visit(tile) with the first tile of this level.
template <class Visit>
void ChangeTile(FloatGrid& grid, openvdb::Index level, Visit visit) {
  auto tile = grid.tree().beginValueAll();
  tile.setMaxDepth(FloatTree::DEPTH - 1 - level);
  tile.setMinDepth(FloatTree::DEPTH - 1 - level);
  if (!tile) throw Failure("there is no such tile");
  visit(tile);
}

void ChangeTileValue(FloatGrid& grid, openvdb::Index level) {
  ChangeTile(grid, level, [](auto& tile) { tile.setValue(*tile + 0.5f); });
}

void ChangeTileState(FloatGrid& grid, openvdb::Index level) {
  ChangeTile(grid, level, [](auto& tile) { tile.setActiveState(!tile.isValueOn()); });
}

// The same values, in a leaf instead of a tile.
void ChangeTopology(FloatGrid& grid) {
  openvdb::Coord at;
  ChangeTile(grid, 1, [&](const auto& tile) { at = tile.getCoord(); });
  grid.tree().touchLeaf(at);
}

const std::map<std::string, std::function<void(FloatGrid&)>>& Changes() {
  using Grid = FloatGrid&;
  static const std::map<std::string, std::function<void(Grid)>> changes = {
      {"nothing", [](Grid) {}},
      {"value", [](Grid g) { ChangeValue(g, true); }},
      {"inactive-value", [](Grid g) { ChangeValue(g, false); }},
      {"state", ChangeState},
      {"tile-value", [](Grid g) { ChangeTileValue(g, 1); }},
      {"tile-state", [](Grid g) { ChangeTileState(g, 1); }},
      {"large-tile-value", [](Grid g) { ChangeTileValue(g, 2); }},
      {"large-tile-state", [](Grid g) { ChangeTileState(g, 2); }},
      {"topology", ChangeTopology},
      {"root-tile", [](Grid g) { g.tree().addTile(3, openvdb::Coord(1 << 20), 0.5f, true); }},
      {"background", [](Grid g) { g.tree().root().setBackground(0.5f, false); }},
      {"metadata", [](Grid g) { g.insertMeta("angle", openvdb::DoubleMetadata(0.5)); }},
      {"metadata-type",
       [](Grid g) {
         g.removeMeta("frame");
         g.insertMeta("frame", openvdb::Int64Metadata(-7));
       }},
      {"metadata-gone", [](Grid g) { g.removeMeta("note"); }},
      {"metadata-new", [](Grid g) { g.insertMeta("new", openvdb::BoolMetadata(true)); }},
      {"metadata-ours", [](Grid g) { g.insertMeta("palpate_x", openvdb::BoolMetadata(true)); }},
      {"name", [](Grid g) { g.setName("other"); }},
      {"class", [](Grid g) { g.setGridClass(openvdb::GRID_STAGGERED); }},
      {"transform",
       [](Grid g) {
         g.transform().postTranslate({1e-9, 0.0, 0.0});
       }},
      {"transform-turn", [](Grid g) { g.transform().postRotate(1e-9, openvdb::math::Z_AXIS); }},
  };
  return changes;
}

class Damage {
 public:
  Damage(std::vector<char>& bytes, unsigned seed) : bytes_(bytes), random_(seed) {}

  void Apply() {
    if (bytes_.empty()) return;
    const std::size_t kind = Below(10);
    if (kind < 4) return FlipBits();
    if (kind < 7) return ChangeLength();
    if (kind < 9) return MoveBlock();
    bytes_.resize(Place());
  }

  std::size_t Below(std::size_t end) { return random_() % end; }

 private:
  // Half of them where the header and the topology are.
  std::size_t Place() {
    return Below(Below(2) ? bytes_.size() : std::min<std::size_t>(bytes_.size(), 3000));
  }

  void FlipBits() {
    for (std::size_t n = 1 + Below(3); n > 0; --n)
      bytes_[Place()] ^= static_cast<char>(1 << Below(8));
  }

  // Of four or eight bytes, wherever they lie.
  void ChangeLength() {
    static constexpr std::int64_t kLengths[] = {
        0, 1, -1, 0x7fffffff, 0x80000000, 0x10000, std::int64_t{1} << 40, std::int64_t{1} << 62};
    const std::int64_t length = kLengths[Below(std::size(kLengths))];
    const std::size_t size = Below(2) ? 4 : 8, place = Place();
    if (place + size <= bytes_.size()) std::memcpy(&bytes_[place], &length, size);
  }

  void MoveBlock() {
    const std::size_t size = std::min<std::size_t>(1 + Below(600), bytes_.size());
    const std::size_t from = Below(bytes_.size() - size + 1), to = Below(bytes_.size() - size + 1);
    std::memmove(&bytes_[to], &bytes_[from], size);
  }

  std::vector<char>& bytes_;
  std::mt19937_64 random_;
};

}  // namespace

void Change(const std::string& what, FloatGrid& grid) {
  const auto change = Changes().find(what);
  if (change == Changes().end()) {
    throw Failure("there is no change " + what + "; the changes are " + ChangeNames());
  }
  change->second(grid);
}

std::string ChangeNames() {
  std::string names;
  for (const auto& [name, change] : Changes()) names += (names.empty() ? "" : ", ") + name;
  return names;
}

std::vector<char> Damaged(std::vector<char> bytes, unsigned seed) {
  Damage damage(bytes, seed);
  // Most have one fault: of many, the reader sees the first.
  for (std::size_t n = damage.Below(4) == 0 ? 3 : 1; n > 0; --n) damage.Apply();
  return bytes;
}

}  // namespace palpate::vdb_tool
