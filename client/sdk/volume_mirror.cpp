#include "client/sdk/volume_mirror.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "common/bricks/float_codec.h"
#include "common/error/error.h"

namespace palpate::client {
namespace {

// The contract says 64. A later daemon may send more, but this is the limit.
constexpr std::size_t kMostBricks = 4096;

void Require(bool holds, const char* what) {
  if (holds) return;
  throw Error(ErrorKind::kInvalidArgument,
              std::string("the stream of the volume makes no sense: ") + what);
}

// A volume one voxel thick fills bricks with 64 times as many voxels as it has.
constexpr double kMostPadding = 8.0;
constexpr double kAlwaysBricks = 4096.0;

// Computes in floating point: the product of three sizes can overflow any integer.
void CheckSize(const Vec3i& size, std::uint64_t max_voxels) {
  Require((size.array() > 0).all(), "a volume without voxels");
  const Vec3 voxels = size.cast<double>();
  const double bricks = (voxels / kBrickEdge).array().ceil().prod();
  const auto most = static_cast<double>(max_voxels);
  if (voxels.prod() > most ||
      bricks > std::max(kAlwaysBricks, kMostPadding * most / kBrickVoxels)) {
    throw Error(ErrorKind::kTooLarge,
                "the daemon's volume has more than " + std::to_string(max_voxels) + " voxels");
  }
}

Vec3i OverviewSize(const Vec3i& size) {
  return {OverviewCount(size.x()), OverviewCount(size.y()), OverviewCount(size.z())};
}

}  // namespace

void VolumeMirror::Reset() {
  lattice_.reset();
  placement_.reset();
  bricks_.clear();
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
  auto background = std::make_shared<Brick>();
  background->fill(lattice.Background());
  bricks_.assign(lattice.Bricks(), background);
  for (std::uint64_t number = 0; number < bricks_.size(); ++number) {
    hash_ += HashOfBrick(*background, number);
  }
  overview_size_ = OverviewSize(lattice.size);
}

void VolumeMirror::Take(const VolumePlacement& placement) { placement_ = placement; }

void VolumeMirror::Take(const VolumeOverview& overview) {
  Require(lattice_.has_value(), "an overview before the lattice");
  Require(overview.size == overview_size_, "an overview of another size");
  // Blocks come in order, so a count tells which are known.
  Require(overview.first_block == overview_known_, "an overview with a gap");
  const std::uint64_t blocks = overview_size_.cast<std::uint64_t>().prod();
  const std::size_t count = CountFloats(overview.zstd_values, blocks - overview_known_);
  overview_.resize(blocks);
  DecompressFloats(overview.zstd_values, std::span(overview_).subspan(overview_known_, count));
  overview_known_ += count;
}

void VolumeMirror::Take(const VolumeBricks& bricks) {
  Require(lattice_.has_value(), "bricks before the lattice");
  const std::vector<std::uint64_t>& numbers = bricks.numbers;
  Require(!numbers.empty() && numbers.size() <= kMostBricks, "too few or too many bricks");
  Require(std::adjacent_find(numbers.begin(), numbers.end(), std::greater_equal()) == numbers.end(),
          "bricks that do not ascend");
  Require(numbers.back() < bricks_.size(), "a brick outside of the volume");
  Require(bricks.bricks_left <= bricks_.size(), "more bricks to come than there are");
  std::vector<float> values(numbers.size() * kBrickVoxels);
  DecompressFloats(bricks.zstd_values, values);
  is_complete_ = false;
  bricks_left_ = bricks.bricks_left;
  for (std::size_t n = 0; n < numbers.size(); ++n) {
    Put(numbers[n], std::span(values).subspan(n * kBrickVoxels, kBrickVoxels));
  }
}

void VolumeMirror::Put(std::uint64_t number, std::span<const float> values) {
  auto brick = std::make_shared<Brick>();
  std::copy(values.begin(), values.end(), brick->begin());
  hash_ -= HashOfBrick(*bricks_[number], number);
  hash_ += HashOfBrick(*brick, number);
  bricks_[number] = std::move(brick);
  if (!changes_.all) changes_.numbers.push_back(number);
}

void VolumeMirror::Take(const VolumeComplete& complete) {
  Require(lattice_.has_value(), "a complete volume before the lattice");
  if (complete.content_hash != hash_) {
    throw Error(ErrorKind::kInternal,
                "the copy of the volume is not that of the daemon at revision " +
                    std::to_string(complete.revision.volume_revision) + ": fetch it anew");
  }
  resume_ = complete.revision;
  is_complete_ = true;
  bricks_left_ = 0;
}

float VolumeMirror::Value(int i, int j, int k) const {
  const Vec3i brick(i / kBrickEdge, j / kBrickEdge, k / kBrickEdge);
  return (*bricks_[BrickNumber(brick, lattice_->BrickCounts())])[VoxelInBrick(i, j, k)];
}

std::span<const float> VolumeMirror::overview() const {
  if (overview_.empty() || overview_known_ < overview_.size()) return {};
  return overview_;
}

MirrorChanges VolumeMirror::TakeChanges() {
  MirrorChanges changes = std::exchange(changes_, {});
  auto& numbers = changes.numbers;
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  return changes;
}

}  // namespace palpate::client
