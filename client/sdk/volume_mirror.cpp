#include "client/sdk/volume_mirror.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::client {
namespace {

// Far more than a daemon sends in a message.
constexpr std::size_t kMostBricks = 4096;
constexpr std::size_t kMostTiles = 65536;
constexpr std::uint64_t kMostTileBricks = std::uint64_t{1} << 20;

void Require(bool holds, const char* what) {
  if (holds) return;
  throw Error(ErrorKind::kInvalidArgument,
              std::string("the stream of the volume makes no sense: ") + what);
}

// A volume one voxel thick fills bricks with 64 times as many voxels as it has.
constexpr double kMostPadding = 8.0;
constexpr double kAlwaysBricks = 4096.0;
constexpr int kMostEdge = 1 << 30;  // voxels

// Computes in floating point: the product of three sizes can overflow any integer.
void CheckSize(const Vec3i& size, std::uint64_t max_voxels) {
  Require((size.array() > 0).all(), "a volume without voxels");
  const Vec3 voxels = size.cast<double>();
  const double bricks = (voxels / kBrickEdge).array().ceil().prod();
  const auto most = static_cast<double>(max_voxels);
  if (size.maxCoeff() > kMostEdge || voxels.prod() > most ||
      bricks > std::max(kAlwaysBricks, kMostPadding * most / kBrickVoxels)) {
    throw Error(ErrorKind::kTooLarge,
                "the daemon's volume has more than " + std::to_string(max_voxels) + " voxels");
  }
}

void CheckPlaces(const VolumeBricks& bricks, std::uint64_t most) {
  const std::vector<std::uint64_t>& numbers = bricks.numbers;
  Require(!numbers.empty() || !bricks.tiles.empty(), "a message without bricks");
  Require(numbers.size() <= kMostBricks && bricks.tiles.size() <= kMostTiles, "too many bricks");
  Require(std::adjacent_find(numbers.begin(), numbers.end(), std::greater_equal()) == numbers.end(),
          "bricks that do not ascend");
  Require(numbers.empty() || numbers.back() < most, "a brick outside of the volume");
  Require(bricks.bricks_left <= most, "more bricks to come than there are");
  std::uint64_t end = 0;
  std::uint64_t tile_bricks = 0;
  for (const VolumeTile& tile : bricks.tiles) {
    const BrickRun& run = tile.bricks;
    Require(run.count > 0 && run.first >= end, "tiles that do not ascend");
    Require(run.first < most && run.count <= most - run.first, "a tile outside of the volume");
    end = run.end();
    tile_bricks += run.count;
    Require(tile_bricks <= kMostTileBricks, "too many bricks in tiles");
    const auto within = std::lower_bound(numbers.begin(), numbers.end(), run.first);
    Require(within == numbers.end() || *within >= end, "a brick within a tile");
  }
}

Vec3i OverviewSize(const Vec3i& size) {
  return {OverviewCount(size.x()), OverviewCount(size.y()), OverviewCount(size.z())};
}

}  // namespace

void VolumeMirror::Reset() {
  lattice_.reset();
  placement_.reset();
  bricks_ = {};
  background_.reset();
  constants_.clear();
  hash_ = {};
  resume_.reset();
  is_complete_ = false;
  bricks_left_ = 0;
  overview_size_ = Vec3i::Zero();
  overview_.clear();
  overview_known_ = 0;
  changes_ = {.all = true};
}

void VolumeMirror::Apply(const VolumeEvent& event) {
  try {
    std::visit([this](const auto& held) { Take(held); }, event);
  } catch (...) {
    Reset();
    throw;
  }
}

void VolumeMirror::Take(const VolumeLattice& lattice) {
  CheckSize(lattice.size, max_voxels_);
  Require(std::isfinite(lattice.value_min) && std::isfinite(lattice.value_max) &&
              std::isfinite(lattice.Background()),
          "a range that is not finite");
  Reset();
  lattice_ = lattice;
  background_ = ConstantBrick(lattice.Background());
  bricks_ = BrickMap(lattice.BrickCounts(), background_);
  overview_size_ = OverviewSize(lattice.size);
}

void VolumeMirror::Take(const VolumePlacement& placement) { placement_ = placement; }

void VolumeMirror::Take(const VolumeOverview& overview) {
  Require(lattice_.has_value(), "an overview before the lattice");
  Require(overview.size == overview_size_, "an overview of another size");
  // Blocks come in order, so a count tells which are known.
  Require(overview.first_block == overview_known_, "an overview with a gap");
  const std::uint64_t blocks = overview_size_.cast<std::uint64_t>().prod();
  const std::size_t count =
      CountValues(overview.zstd_values, sizeof(float), blocks - overview_known_);
  overview_.resize(blocks);
  Decompress(overview.zstd_values, std::span(overview_).subspan(overview_known_, count));
  overview_known_ += count;
}

void VolumeMirror::Take(const VolumeBricks& bricks) {
  Require(lattice_.has_value(), "bricks before the lattice");
  CheckPlaces(bricks, bricks_.size());
  is_complete_ = false;
  bricks_left_ = bricks.bricks_left;
  VisitType(bricks.type, [&](auto voxel) {
    using T = decltype(voxel);
    std::vector<T> values(bricks.numbers.size() * kBrickVoxels);
    if (!values.empty()) Decompress(bricks.zstd_values, std::span(values));
    const T* first = values.data();
    for (const std::uint64_t number : bricks.numbers) {
      Put({number, 1}, TypedBrick::Of(std::span<const T, kBrickVoxels>(first, kBrickVoxels)));
      first += kBrickVoxels;
    }
  });
  for (const VolumeTile& tile : bricks.tiles) Put(tile.bricks, ConstantBrick(tile.value));
}

void VolumeMirror::Put(BrickRun run, const TypedBrickPtr& brick) {
  const Brick after = brick->Floats();
  TypedBrickPtr old;
  Brick before;
  for (std::uint64_t number = run.first; number < run.end(); ++number) {
    const TypedBrickPtr& present = bricks_.At(number);
    if (present == brick) continue;
    // The bricks before a tile are mostly one object.
    if (present != old) {
      old = present;
      old->CopyTo(before);
    }
    hash_ -= HashOfBrick(before, number);
    hash_ += HashOfBrick(after, number);
  }
  bricks_.Fill(run, brick);
  AddTo(changes_.bricks, run);
}

// One object for all tiles of a value. Values that no brick has any more are forgotten, also if the
// daemon never completes a revision.
const TypedBrickPtr& VolumeMirror::ConstantBrick(float value) {
  if (constants_.size() > most_constants_) {
    std::erase_if(constants_, [](const auto& held) { return held.second.use_count() == 1; });
    most_constants_ = std::max(kLeastConstants, 2 * constants_.size());
  }
  TypedBrickPtr& brick = constants_[std::bit_cast<std::uint32_t>(value)];
  if (!brick) {
    const LeafType type = Holds(lattice_->type, value) ? lattice_->type : LeafType::kFloat;
    brick = TypedBrick::Constant(type, value);
  }
  return brick;
}

void VolumeMirror::Take(const VolumeComplete& complete) {
  Require(lattice_.has_value(), "a complete volume before the lattice");
  ContentHash hash = hash_;
  hash += complete.background_hash;
  if (complete.content_hash != hash) {
    throw Error(ErrorKind::kInternal,
                "the copy of the volume is not that of the daemon at revision " +
                    std::to_string(complete.revision.volume_revision) + ": fetch it anew");
  }
  resume_ = complete.revision;
  content_hash_ = hash;
  is_complete_ = true;
  bricks_left_ = 0;
}

std::span<const float> VolumeMirror::overview() const {
  if (overview_.empty() || overview_known_ < overview_.size()) return {};
  return overview_;
}

MirrorChanges VolumeMirror::TakeChanges() {
  MirrorChanges changes = std::exchange(changes_, {});
  Join(changes.bricks);
  return changes;
}

}  // namespace palpate::client
