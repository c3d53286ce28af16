#include "server/volume/snapshot/brick_packer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate {
namespace {

// A message has at most so many tiles, of so many bricks.
constexpr std::size_t kTilesPerMessage = 4096;
constexpr std::uint64_t kTileBricksPerMessage = 65536;

std::uint32_t BitsOf(float value) { return std::bit_cast<std::uint32_t>(value); }

// Voxels as they lie in the leaf.
std::span<const std::byte> BytesOf(const Leaf& leaf) {
  return VisitType(leaf.type(), [&](auto voxel) {
    return std::as_bytes(std::span(leaf.values<decltype(voxel)>(), kBrickVoxels));
  });
}

// Also true for a leaf that an edit filled with one value.
bool IsOneValue(const Leaf& leaf) {
  if (leaf.is_constant()) return true;
  const std::span<const std::byte> bytes = BytesOf(leaf);
  const std::size_t voxel = VoxelBytes(leaf.type());
  return std::memcmp(bytes.data(), bytes.data() + voxel, bytes.size() - voxel) == 0;
}

void Require(bool holds, const char* what) {
  if (!holds) throw Error(ErrorKind::kInvalidArgument, what);
}

}  // namespace

bool BrickPacker::Add(std::uint64_t number, const Leaf& leaf) {
  return IsOneValue(leaf) ? AddTile(number, leaf[0]) : AddBrick(number, leaf);
}

VolumeBricks BrickPacker::Take() {
  if (!bricks_.numbers.empty()) bricks_.zstd_values = CompressBytes(voxels_);
  return std::move(bricks_);
}

bool BrickPacker::AddBrick(std::uint64_t number, const Leaf& leaf) {
  if (!bricks_.numbers.empty() && bricks_.type != leaf.type()) return false;
  if (voxels_.size() >= kBytesPerMessage) return false;
  bricks_.type = leaf.type();
  bricks_.numbers.push_back(number);
  const std::span<const std::byte> bytes = BytesOf(leaf);
  voxels_.insert(voxels_.end(), bytes.begin(), bytes.end());
  return true;
}

bool BrickPacker::AddTile(std::uint64_t number, float value) {
  std::vector<VolumeTile>& tiles = bricks_.tiles;
  if (++tile_bricks_ > kTileBricksPerMessage) return false;
  if (!tiles.empty() && tiles.back().bricks.end() == number &&
      BitsOf(tiles.back().value) == BitsOf(value)) {
    ++tiles.back().bricks.count;
    return true;
  }
  if (tiles.size() == kTilesPerMessage) return false;
  tiles.push_back({{number, 1}, value});
  return true;
}

void UnpackBricks(const VolumeBricks& bricks,
                  const std::function<void(std::uint64_t, LeafPtr)>& take) {
  const std::size_t count = bricks.numbers.size();
  Require(count <= BrickPacker::kBytesPerMessage / kBrickVoxels + 1, "too many bricks");
  Require(bricks.tiles.size() <= kTilesPerMessage, "too many tiles");
  VisitType(bricks.type, [&](auto voxel) {
    std::vector<decltype(voxel)> values(count * kBrickVoxels);
    if (count > 0) Decompress(bricks.zstd_values, std::span(values));
    for (std::size_t n = 0; n < count; ++n) {
      Brick brick;
      std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(n * kBrickVoxels), kBrickVoxels,
                  brick.begin());
      take(bricks.numbers[n], Leaf::Of(bricks.type, brick));
    }
  });
  std::uint64_t tile_bricks = 0;
  for (const VolumeTile& tile : bricks.tiles) {
    Require(tile.bricks.count > 0, "a tile of no bricks");
    Require(tile.bricks.count <= kTileBricksPerMessage - tile_bricks, "too many bricks in tiles");
    tile_bricks += tile.bricks.count;
    Brick brick;
    brick.fill(tile.value);
    const LeafPtr leaf = Leaf::Constant(Leaf::Smallest(brick)->type(), tile.value);
    for (std::uint64_t n = 0; n < tile.bricks.count; ++n) take(tile.bricks.first + n, leaf);
  }
}

}  // namespace palpate
