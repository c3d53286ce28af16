// A hand-over in the form of a tree: what is written comes back, and whatever lies in the file, the
// daemon takes a volume or refuses it.
#include "server/volume/load/tree_handover.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/volume/snapshot/brick_memory.h"
#include "server/volume/snapshot/grid_tree.h"
#include "tests/support/refusal.h"
#include "tests/support/written_tree.h"

namespace palpate {
namespace {

using testing::Refusal;

using testing::WrittenTree;

LoadedVolume Take(const std::string& bytes, const TakeOptions& options = {}) {
  const Descriptor file = MakeHandoverFile();
  EXPECT_EQ(write(file.get(), bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  return TakeHandover(file.get(), options);
}

std::string Valid() {
  WrittenTree written;
  written.Count();
  return written.Bytes();
}

float At(const LoadedVolume& volume, int i, int j, int k) {
  return volume.bricks.Find(i, j, k)[VoxelInBrick(i, j, k)];
}

TEST(TreeHandover, WhatIsWrittenComesBack) {
  const LoadedVolume volume = Take(Valid());
  EXPECT_EQ(volume.metadata.size, Vec3i(160, 16, 8));
  EXPECT_EQ(At(volume, 1, 2, 3), 64.0f + 16.0f + 3.0f);
  EXPECT_EQ(At(volume, 17, 10, 3), -83.0f);
  EXPECT_EQ(At(volume, 8, 0, 0), 3.0f);     // the tile at the origin
  EXPECT_EQ(At(volume, 136, 15, 7), 9.0f);  // that of 128³ voxels
  EXPECT_EQ(At(volume, 30, 0, 0), -5.0f);
  EXPECT_EQ(volume.metadata.value_min, -511.0);
  EXPECT_EQ(volume.metadata.value_max, 511.0);
  const Leaf& leaf = volume.bricks.Find(0, 0, 0);
  EXPECT_EQ(leaf.type(), LeafType::kInt16);
  for (std::size_t n = 0; n < 512; ++n) {
    EXPECT_EQ(leaf.IsActive(n), n / 64 == 3 && n / 8 % 2 == 1);
  }
  EXPECT_TRUE(volume.bricks.Find(8, 0, 0).IsActive(0));
  EXPECT_FALSE(volume.bricks.Find(30, 0, 0).IsActive(0));
}

// A file of 4 MB may name a million tiles.
TEST(TreeHandover, NoMoreMemoryIsTakenThanWasGrantedBefore) {
  WrittenTree many;
  // All beyond the lattice, of values of their own.
  for (int n = 2; n < 32 * 32 * 32; ++n) {
    many.tiles.push_back({{128 * (n & 31), 128 * (n >> 5 & 31), 128 * (n >> 10)},
                          kGridNodeEdge,
                          static_cast<float>(n - 10'000),
                          1});
  }
  many.Count();
  for (const std::string& bytes : {Valid(), many.Bytes()}) {
    const std::uint64_t before = LiveBrickBytes();
    std::uint64_t granted = 0;
    const LoadedVolume volume =
        Take(bytes, {.on_size = [&](const Vec3i&, const LoadMemory& memory) {
               EXPECT_LE(LiveBrickBytes() - before, granted);
               granted = memory.volume_bytes;
             }});
    EXPECT_LE(LiveBrickBytes() - before, granted);
    EXPECT_GE(granted, volume.bricks.MemoryBytes());
    EXPECT_LE(granted, volume.bricks.MemoryBytes() + (64 << 10));
  }
}

TEST(TreeHandover, WhatElseTheGridWasIsKept) {
  const LoadedVolume volume = Take(Valid());
  ASSERT_NE(volume.metadata.grid_form, nullptr);
  const GridForm& form = *volume.metadata.grid_form;
  EXPECT_EQ(form.first, Vec3i(-8, 0, 0));
  EXPECT_EQ(form.type, "int32");
  EXPECT_EQ(form.map, "UniformScaleMap");
  EXPECT_EQ(form.background, -5.0f);
  ASSERT_EQ(form.entries.size(), 2u);
  EXPECT_EQ(form.entries[0].name, "author");
  EXPECT_EQ(form.entries[0].bytes, "somebody");
  EXPECT_EQ(form.entries[1].type->name, "int32");
  EXPECT_EQ(form.nodes.size(), 2u);
  EXPECT_EQ(form.top_nodes.size(), 2u);
  ASSERT_EQ(form.tiles.size(), 2u);
  EXPECT_EQ(form.tiles[0].edge, kGridNodeEdge);
  EXPECT_EQ(form.tiles[1].first, Vec3i(0, 0, 40));
  EXPECT_EQ(form.tiles[1].value, 4.0f);
}

void ExpectTreeRefused(const char* what, const std::function<void(WrittenTree&)>& change,
                       ErrorKind kind = ErrorKind::kInvalidArgument) {
  WrittenTree written;
  written.Count();
  change(written);
  EXPECT_EQ(Refusal([&] { Take(written.Bytes()); }), kind) << what;
}

TEST(TreeHandover, LiesOfTheHeaderAreRefused) {
  constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();
  ExpectTreeRefused("form", [](WrittenTree& w) { w.header.form = 2; });
  ExpectTreeRefused("type", [](WrittenTree& w) { w.header.type = 4; });
  ExpectTreeRefused("first", [](WrittenTree& w) { w.header.tree.first[0] = -7; });
  ExpectTreeRefused("far", [](WrittenTree& w) { w.header.tree.first[1] = 1 << 30; });
  ExpectTreeRefused("size", [](WrittenTree& w) { w.header.size[2] = 0; });
  ExpectTreeRefused(
      "large", [](WrittenTree& w) { w.header.size[0] = w.header.size[1] = 1 << 20; },
      ErrorKind::kTooLarge);
  ExpectTreeRefused("background", [](WrittenTree& w) { w.header.tree.background = kNoNumber; });
  ExpectTreeRefused("not of its type", [](WrittenTree& w) { w.header.tree.background = 0.5f; });
  ExpectTreeRefused("grid", [](WrittenTree& w) { w.header.tree.grid_type = 5; });
  ExpectTreeRefused("map", [](WrittenTree& w) { w.header.tree.map = 8; });
  ExpectTreeRefused("matrix", [](WrittenTree& w) { w.header.tree.matrix[3] = kNoNumber; });
  ExpectTreeRefused("spacing", [](WrittenTree& w) { w.header.spacing_mm[0] = 0.0; });
  for (std::uint64_t HandoverTree::*const count :
       {&HandoverTree::entry_bytes, &HandoverTree::top_nodes, &HandoverTree::tiles,
        &HandoverTree::nodes, &HandoverTree::leaves}) {
    for (const std::uint64_t is : {std::uint64_t{0}, std::uint64_t{3}, kMost, kMost / 2080 + 1}) {
      WrittenTree written;
      written.Count();
      written.header.tree.*count = is;
      const auto kind = Refusal([&] { Take(written.Bytes()); });
      EXPECT_TRUE(kind == ErrorKind::kInvalidArgument || kind == ErrorKind::kTooLarge) << is;
    }
  }
}

TEST(TreeHandover, LiesOfThePartsAreRefused) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  ExpectTreeRefused("top node", [](WrittenTree& w) { w.top_nodes[0][1] = 8; });
  ExpectTreeRefused("twice", [](WrittenTree& w) { w.top_nodes[0] = w.top_nodes[1]; });
  ExpectTreeRefused("tile", [](WrittenTree& w) { w.tiles[0].first[0] = 120; });
  ExpectTreeRefused("tile's edge", [](WrittenTree& w) { w.tiles[0].edge = 64; });
  ExpectTreeRefused("tile's value", [](WrittenTree& w) { w.tiles[0].value = kInfinity; });
  ExpectTreeRefused("tile on a node", [](WrittenTree& w) { w.tiles[0].first[0] = 0; });
  ExpectTreeRefused("tile without a node above",
                    [](WrittenTree& w) { w.tiles[0].first[2] = 4096; });
  ExpectTreeRefused("node", [](WrittenTree& w) { w.nodes[0].first[0] = -120; });
  ExpectTreeRefused("node twice", [](WrittenTree& w) { w.nodes[0] = w.nodes[1]; });
  ExpectTreeRefused("node without one above", [](WrittenTree& w) { w.nodes[0].first[2] = 4096; });
  ExpectTreeRefused("a node's tile", [](WrittenTree& w) { w.nodes[1].values[7] = 0.25f; });
  ExpectTreeRefused("a leaf too many", [](WrittenTree& w) { w.nodes[1].is_leaf[9] = 1; });
  ExpectTreeRefused("a leaf too few", [](WrittenTree& w) { w.nodes[0] = HandoverNode{}; });
  ExpectTreeRefused("leaf's place", [](WrittenTree& w) { w.leaf_places[0][1] = 4; });
  ExpectTreeRefused("leaf on a tile", [](WrittenTree& w) { w.leaf_places[1][0] = 0; });
  ExpectTreeRefused("leaf twice", [](WrittenTree& w) { w.leaf_places[0] = w.leaf_places[1]; });
  ExpectTreeRefused("entry's type", [](WrittenTree& w) { w.entries[0] = 77; });
  ExpectTreeRefused("entry's name", [](WrittenTree& w) { w.entries[7] = 1; });
  ExpectTreeRefused("entry's value", [](WrittenTree& w) { w.entries[11] = 1; });
  ExpectTreeRefused("a constant volume", [](WrittenTree& w) {
    w.tiles.clear();
    w.nodes.clear();
    w.leaves.clear();
    w.leaf_places.clear();
    w.Count();
  });
}

TEST(TreeHandover, FloatsThatAreNoneAreRefused) {
  WrittenTree written;
  written.header.type = static_cast<std::uint32_t>(LeafType::kFloat);
  written.leaves.clear();
  written.Count();
  written.header.tree.leaves = 2;
  std::string bytes = written.Bytes() + std::string(2 * (64 + 4 * 512), '\0');
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NO_THROW(Take(bytes));
  std::memcpy(bytes.data() + bytes.size() - sizeof nan, &nan, sizeof nan);
  EXPECT_EQ(Refusal([&] { Take(bytes); }), ErrorKind::kInvalidArgument);
}

TEST(TreeHandover, TooManyVoxelsAreRefusedAndManyTilesAreNot) {
  EXPECT_EQ(Refusal([] { Take(Valid(), {.max_voxels = 1023}); }), ErrorKind::kTooLarge);
  EXPECT_NO_THROW(Take(Valid(), {.max_voxels = 1024}));
  // More values than leaves are shared for.
  WrittenTree written;
  written.header.type = static_cast<std::uint32_t>(LeafType::kFloat);
  written.leaves.clear();
  written.leaf_places.clear();
  written.nodes.assign(5, {});
  for (int n = 0; n < 5; ++n) {
    written.nodes[static_cast<std::size_t>(n)].first[1] = 128 * n;
    for (int place = 0; place < HandoverNode::kPlaces; ++place) {
      written.nodes[static_cast<std::size_t>(n)].values[place] =
          static_cast<float>(n * HandoverNode::kPlaces + place);
    }
  }
  written.Count();
  written.header.size[1] = 5 * 128;
  const LoadedVolume volume = Take(written.Bytes());
  for (int n = 0; n < 5; ++n) {
    EXPECT_EQ(At(volume, 16, 128 * n, 0), static_cast<float>(n * HandoverNode::kPlaces + 256));
    EXPECT_EQ(At(volume, 8, 128 * n + 15, 7), static_cast<float>(n * HandoverNode::kPlaces + 16));
  }
}

}  // namespace
}  // namespace palpate
