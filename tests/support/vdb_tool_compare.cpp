#include <cstring>
#include <map>
#include <sstream>
#include <type_traits>

#include "tests/support/vdb_tool.h"

namespace palpate::vdb_tool {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::Index;

// Bit by bit: -0 is not 0, and a NaN is itself.
template <class Value>
bool Same(const Value& a, const Value& b) {
  return std::memcmp(&a, &b, sizeof(Value)) == 0;
}

std::string Text(const Coord& at) {
  std::ostringstream text;
  text << at;
  return text.str();
}

template <class Value>
std::string Text(const Value& value, bool active) {
  std::ostringstream text;
  text.precision(17);
  text << value << (active ? " (active)" : " (inactive)");
  return text.str();
}

// A node of a tree, or the tile in its place.
template <class Node>
struct Place {
  const Node* node = nullptr;
  typename Node::ValueType value{};
  bool active = false;
};

template <class Node>
constexpr bool kIsLeaf = Node::LEVEL == 0;

// Walks both trees at once, from the root to the voxels.
template <class Tree>
class Walk {
 public:
  using Value = typename Tree::ValueType;
  using Root = typename Tree::RootNodeType;

  Difference Compare(const Tree& a, const Tree& b) {
    const auto tiles_a = Children(a.root()), tiles_b = Children(b.root());
    auto all = tiles_a;
    all.insert(tiles_b.begin(), tiles_b.end());
    for (const auto& [origin, unused] : all) {
      CompareNodes(At(tiles_a, origin, a), At(tiles_b, origin, b), origin);
    }
    return difference_;
  }

 private:
  using Top = typename Root::ChildNodeType;
  using TopPlaces = std::map<Coord, Place<Top>>;

  static TopPlaces Children(const Root& root) {
    TopPlaces places;
    for (auto at = root.cbeginChildOn(); at; ++at) places[at.getCoord()].node = &*at;
    for (auto at = root.cbeginValueAll(); at; ++at) {
      places[at.getCoord()] = {nullptr, *at, at.isValueOn()};
    }
    return places;
  }

  static Place<Top> At(const TopPlaces& places, const Coord& origin, const Tree& tree) {
    const auto found = places.find(origin);
    return found == places.end() ? Place<Top>{nullptr, tree.background(), false} : found->second;
  }

  template <class Node>
  static auto Child(const Place<Node>& place, Index n) {
    using ChildNode = typename Node::ChildNodeType;
    if (!place.node) return Place<ChildNode>{nullptr, place.value, place.active};
    const auto& entry = place.node->getTable()[n];
    if (place.node->getChildMask().isOn(n)) {
      return Place<ChildNode>{entry.getChild(), Value{}, false};
    }
    return Place<ChildNode>{nullptr, entry.getValue(), place.node->getValueMask().isOn(n)};
  }

  template <class Node>
  void CompareNodes(const Place<Node>& a, const Place<Node>& b, const Coord& origin) {
    if (!a.node != !b.node) {
      ++difference_.nodes;
      Say("at " + Text(origin) + " one has a node of " + std::to_string(Node::DIM) +
          " voxels' edge, the other a tile");
    }
    if (!a.node && !b.node) {
      CompareValues(a.value, a.active, b.value, b.active,
                    CoordBBox::createCube(origin, static_cast<int>(Node::DIM)));
    } else if constexpr (kIsLeaf<Node>) {
      CompareVoxels(a, b, origin);
    } else {
      for (Index n = 0; n < Node::NUM_VALUES; ++n) {
        const Node& node = a.node ? *a.node : *b.node;
        CompareNodes(Child(a, n), Child(b, n), node.offsetToGlobalCoord(n));
      }
    }
  }

  template <class Leaf>
  void CompareVoxels(const Place<Leaf>& a, const Place<Leaf>& b, const Coord& origin) {
    const auto value = [](const Place<Leaf>& place, Index n) {
      return place.node ? Value(place.node->getValue(n)) : place.value;
    };
    const auto active = [](const Place<Leaf>& place, Index n) {
      return place.node ? place.node->isValueOn(n) : place.active;
    };
    for (Index n = 0; n < Leaf::NUM_VALUES; ++n) {
      const Coord at = origin + Leaf::offsetToLocalCoord(n);
      CompareValues(value(a, n), active(a, n), value(b, n), active(b, n), {at, at});
    }
  }

  void CompareValues(const Value& a, bool a_active, const Value& b, bool b_active,
                     const CoordBBox& box) {
    if (Same(a, b) && a_active == b_active) return;
    difference_.voxels += static_cast<std::int64_t>(box.volume());
    difference_.box.expand(box);
    if (difference_.first.empty()) {
      Say("at " + Text(box.min()) + (box.volume() > 1 ? " (a tile) " : " ") + Text(a, a_active) +
          " is " + Text(b, b_active));
    }
  }

  void Say(const std::string& what) {
    if (difference_.first.empty()) difference_.first = what;
  }

  Difference difference_;
};

// The same by OpenVDB's own iterators, over tiles of all levels and voxels: a mistake of Walk
// shows itself. Empty: they are equal.
template <class Tree>
std::string CompareByIterators(const Tree& a, const Tree& b) {
  if (!a.hasSameTopology(b)) return "hasSameTopology() says no";
  if (a.leafCount() != b.leafCount()) return "the numbers of leaves differ";
  if (a.nonLeafCount() != b.nonLeafCount()) return "the numbers of inner nodes differ";
  if (a.activeVoxelCount() != b.activeVoxelCount()) return "the numbers of active voxels differ";
  auto at_a = a.cbeginValueAll();
  auto at_b = b.cbeginValueAll();
  for (; at_a && at_b; ++at_a, ++at_b) {
    CoordBBox box_a, box_b;
    at_a.getBoundingBox(box_a);
    at_b.getBoundingBox(box_b);
    if (at_a.getLevel() != at_b.getLevel() || box_a != box_b ||
        at_a.isValueOn() != at_b.isValueOn() || !Same(at_a.getValue(), at_b.getValue())) {
      return "the iterators differ at " + Text(box_a.min()) + " of " +
             Text(at_a.getValue(), at_a.isValueOn()) + " and " + Text(box_b.min()) + " of " +
             Text(at_b.getValue(), at_b.isValueOn());
    }
  }
  return bool(at_a) == bool(at_b) ? "" : "one tree has more values";
}

// Tiles of the root without anything are as none; OpenVDB's comparison counts them.
template <class Tree>
void DropEmptyTiles(const Tree& tree) {
  const_cast<Tree&>(tree).root().eraseBackgroundTiles();
}

template <class Tree>
std::string FirstDifferenceOfTrees(const Tree& a, const Tree& b) {
  DropEmptyTiles(a);
  DropEmptyTiles(b);
  if (!Same(a.background(), b.background())) {
    return "background " + Text(a.background(), false) + " is " + Text(b.background(), false);
  }
  const std::string first = Walk<Tree>().Compare(a, b).first;
  if (!first.empty()) return first;
  return CompareByIterators(a, b);
}

std::string RoundedDifference(const openvdb::GridBase& a, const openvdb::GridBase& b) {
  const auto rounded = [](const openvdb::GridBase& grid) {
    openvdb::FloatTree::Ptr tree;
    VisitGrid(grid, [&](const auto& typed) {
      using Grid = std::decay_t<decltype(typed)>;
      if constexpr (std::is_arithmetic_v<typename Grid::ValueType>) {
        tree = std::make_shared<openvdb::FloatTree>(typed.tree());
      }
    });
    if (!tree) throw Failure("the values of " + grid.type() + " are no numbers");
    return tree;
  };
  return FirstDifferenceOfTrees(*rounded(a), *rounded(b));
}

bool Begins(const std::string& name, const std::string& start) { return name.rfind(start, 0) == 0; }

std::string MetadataDifference(const openvdb::MetaMap& a, const openvdb::MetaMap& b) {
  for (auto entry = a.beginMeta(); entry != a.endMeta(); ++entry) {
    const auto& [name, value] = *entry;
    // Of the file: OpenVDB writes it anew.
    if (Begins(name, "file_")) continue;
    const auto other = b[name];
    if (!other) return "the metadata " + name + " is missing";
    if (*value != *other)
      return "the metadata " + name + " " + value->str() + " is " + other->str();
  }
  for (auto entry = b.beginMeta(); entry != b.endMeta(); ++entry) {
    const std::string& name = entry->first;
    if (!a[name] && !Begins(name, "file_") && !Begins(name, "palpate_")) {
      return "the metadata " + name + " is new";
    }
  }
  return "";
}

std::string TransformDifference(const openvdb::math::Transform& a,
                                const openvdb::math::Transform& b) {
  if (a.mapType() != b.mapType()) {
    return "the transform is a " + b.mapType() + ", not a " + a.mapType();
  }
  // Not a == b, which tolerates a little.
  const auto bytes = [](const openvdb::math::Transform& transform) {
    std::ostringstream out(std::ios::binary);
    transform.write(out);
    return out.str();
  };
  return bytes(a) == bytes(b) ? "" : "the transforms differ";
}

}  // namespace

Difference CompareTrees(const openvdb::GridBase& a, const openvdb::GridBase& b) {
  if (a.type() != b.type()) throw Failure("a grid is of " + a.type() + ", not of " + b.type());
  Difference difference;
  const bool known = VisitGrid(a, [&](const auto& typed) {
    using Grid = std::decay_t<decltype(typed)>;
    using Tree = typename Grid::TreeType;
    difference = Walk<Tree>().Compare(typed.tree(), static_cast<const Grid&>(b).tree());
  });
  if (!known) throw Failure("grids of " + a.type() + " are not compared");
  return difference;
}

std::string FirstDifference(const openvdb::GridBase& a, const openvdb::GridBase& b, bool rounded) {
  if (!rounded && a.type() != b.type()) {
    return "the type is " + b.type() + ", not " + a.type();
  }
  if (a.getGridClass() != b.getGridClass()) {
    return "the class is '" + openvdb::GridBase::gridClassToString(b.getGridClass()) + "', not '" +
           openvdb::GridBase::gridClassToString(a.getGridClass()) + "'";
  }
  std::string first = TransformDifference(a.transform(), b.transform());
  if (first.empty()) first = MetadataDifference(a, b);
  if (!first.empty()) return first;
  if (rounded) return RoundedDifference(a, b);
  const bool known = VisitGrid(a, [&](const auto& typed) {
    using Grid = std::decay_t<decltype(typed)>;
    first = FirstDifferenceOfTrees(typed.tree(), static_cast<const Grid&>(b).tree());
  });
  if (!known) throw Failure("grids of " + a.type() + " are not compared");
  return first;
}

}  // namespace palpate::vdb_tool
