// The bytes of a small handed-over tree, in parts, for tests to change.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "server/volume/load/handover.h"
#include "server/volume/snapshot/grid_tree.h"

namespace palpate::testing {

using Place = std::array<std::int32_t, 3>;

struct LeafRecord {
  std::uint64_t states[8];
  std::int16_t values[512];
};

// Two leaves and some tiles around the origin of a grid. The grid's lattice begins at (-8, 0, 0).
struct WrittenTree {
  HandoverHeader header{};
  std::string entries;
  std::vector<Place> top_nodes{{-4096, 0, 0}, {0, 0, 0}};
  std::vector<HandoverTile> tiles;
  std::vector<HandoverNode> nodes;
  std::vector<Place> leaf_places{{-8, 0, 0}, {8, 8, 0}};
  std::vector<LeafRecord> leaves;

  WrittenTree() {
    VolumeMetadata metadata;
    metadata.size = {160, 16, 8};
    metadata.original_type = "int32";
    metadata.source = "a.vdb";
    header = MakeHandoverHeader(metadata, LeafType::kInt16);
    header.form = static_cast<std::uint32_t>(HandoverForm::kTree);
    header.tree.first[0] = -8;
    header.tree.background = -5.0f;
    header.tree.grid_type = 2;
    header.tree.map = 0;
    for (int n = 0; n < 4; ++n) header.tree.matrix[5 * n] = 1.0;
    AddEntry("author", 0, "somebody");
    AddEntry("number", 2, std::string("\x07\0\0\0", 4));
    tiles.push_back({{128, 0, 0}, kGridNodeEdge, 9.0f, 1});
    nodes.resize(2);
    nodes[0].first[0] = -128;
    for (HandoverNode& node : nodes) std::fill_n(node.values, HandoverNode::kPlaces, -5.0f);
    SetLeaf(nodes[0], 15, 0);
    SetLeaf(nodes[1], 1, 1);
    nodes[1].values[0] = 3.0f;  // at the origin
    nodes[1].is_active[0] = 1;
    nodes[1].values[5] = 4.0f;  // beyond the lattice
    leaves.resize(2);
    for (int n = 0; n < 512; ++n) {
      leaves[0].values[n] = static_cast<std::int16_t>(n);
      leaves[1].values[n] = static_cast<std::int16_t>(-n);
    }
    leaves[0].states[3] = 0xff00ff00ff00ff00;
  }
  static void SetLeaf(HandoverNode& node, int a, int b) {
    const int place = a << 8 | b << 4;
    node.is_leaf[place >> 6] |= std::uint64_t{1} << (place & 63);
  }
  void AddEntry(const std::string& name, std::uint32_t type, const std::string& value) {
    const HandoverEntry entry{type, static_cast<std::uint32_t>(name.size()),
                              static_cast<std::uint32_t>(value.size())};
    entries.append(reinterpret_cast<const char*>(&entry), sizeof entry);
    entries += name + value;
  }
  void Count() {
    header.tree.entry_bytes = entries.size();
    header.tree.top_nodes = top_nodes.size();
    header.tree.tiles = tiles.size();
    header.tree.nodes = nodes.size();
    header.tree.leaves = leaves.size();
  }
  std::string Bytes() const {
    std::string bytes(kHandoverVoxels, '\0');
    std::memcpy(bytes.data(), &header, sizeof header);
    bytes += entries;
    const auto add = [&bytes](const auto& items) {
      bytes.append(reinterpret_cast<const char*>(items.data()), items.size() * sizeof items[0]);
    };
    add(top_nodes);
    add(tiles);
    add(nodes);
    add(leaf_places);
    add(leaves);
    return bytes;
  }
};

}  // namespace palpate::testing
