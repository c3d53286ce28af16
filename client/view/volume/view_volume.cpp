#include "client/view/volume/view_volume.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/isosurface/cell.h"

namespace palpate::view {
namespace {

BrickPtr ConstantBrick(float value) {
  auto brick = std::make_shared<Brick>();
  brick->fill(value);
  return brick;
}

bool IsAll(const Brick& brick, float value) {
  return std::all_of(brick.begin(), brick.end(), [value](float v) { return v == value; });
}

// Returns how many voxels of a brick are within the lattice, along each axis.
Vec3i ExtentWithin(const Vec3i& brick, const Vec3i& lattice_size) {
  return (lattice_size - brick * kBrickEdge).cwiseMin(kBrickEdge);
}

// Makes a brick from the overview's means; background beyond the lattice.
BrickPtr StandIn(const Vec3i& brick, const VolumeLattice& lattice, const Vec3i& blocks,
                 std::span<const float> means) {
  auto values = std::make_shared<Brick>();
  const Vec3i extent = ExtentWithin(brick, lattice.size);
  if (extent != Vec3i::Constant(kBrickEdge)) values->fill(lattice.Background());
  for (int i = 0; i < extent.x(); ++i) {
    for (int j = 0; j < extent.y(); ++j) {
      const Vec3i block = (brick * kBrickEdge + Vec3i(i, j, 0)) / kOverviewEdge;
      const float* row =
          &means[(static_cast<std::size_t>(block.x()) * blocks.y() + block.y()) * blocks.z() +
                 block.z()];
      for (int k = 0; k < extent.z(); ++k) {
        (*values)[VoxelInBrick(i, j, k)] = row[k / kOverviewEdge];
      }
    }
  }
  return values;
}

// The range of a brick's voxels from `first` on along each axis; `first` is 0 or 7.
ValueRange RangeOfPart(const Brick& brick, const Vec3i& first) {
  if (first == Vec3i::Zero()) {
    const Eigen::Map<const Eigen::Array<float, kBrickVoxels, 1>> all(brick.data());
    return {all.minCoeff(), all.maxCoeff()};
  }
  ValueRange range{brick.back(), brick.back()};
  for (int i = first.x(); i < kBrickEdge; ++i) {
    for (int j = first.y(); j < kBrickEdge; ++j) {
      for (int k = first.z(); k < kBrickEdge; ++k) {
        const float value = brick[VoxelInBrick(i, j, k)];
        range.min = std::min(range.min, value);
        range.max = std::max(range.max, value);
      }
    }
  }
  return range;
}

}  // namespace

void ViewVolume::Take(const client::VolumeUpdate& update) {
  if (update.all) Begin(update.lattice);
  revision_ = update.complete;
  X_DI_ = update.placement ? std::optional(update.placement->X_DI) : std::nullopt;
  if (!lattice_) return;
  for (const client::ChangedBrick& changed : update.bricks) {
    if (!is_awaited_.empty()) is_awaited_[changed.number] = false;
    Put(changed.number, changed.brick);
  }
  if (update.complete) {
    Complete();
  } else if (!update.overview.empty()) {
    ShowOverview(update.overview_size, update.overview);
  }
  // The library does not know the number of bricks before the first bricks have come.
  bricks_left_ = update.complete ? 0 : std::max<std::uint64_t>(update.bricks_left, 1);
  UpdateCellRanges();
}

void ViewVolume::Begin(const std::optional<VolumeLattice>& lattice) {
  lattice_ = lattice;
  ++version_;
  changes_ = {.all = true};
  const std::uint64_t bricks = lattice_ ? lattice_->Bricks() : 0;
  const float background = lattice_ ? lattice_->Background() : 0.0f;
  background_ = ConstantBrick(background);
  bricks_.assign(bricks, background_);
  is_awaited_.assign(bricks, true);
  is_changed_.assign(bricks, false);
  bricks_left_ = 0;
  histogram_ = lattice_ ? Histogram(lattice_->value_min, lattice_->value_max) : Histogram();
  if (lattice_) histogram_.Add(background, lattice_->size.cast<std::uint64_t>().prod());
  const std::uint64_t cell_bricks = cell_brick_count().cast<std::uint64_t>().prod();
  cell_ranges_.assign(cell_bricks, {background, background});
  is_touched_.assign(cell_bricks, false);
  touched_.clear();
}

void ViewVolume::ShowOverview(const Vec3i& size, std::span<const float> means) {
  for (std::uint64_t number = 0; number < is_awaited_.size(); ++number) {
    if (!is_awaited_[number]) continue;
    Put(number, StandIn(BrickWithNumber(number, lattice_->BrickCounts()), *lattice_, size, means));
  }
}

// Bricks that never came are background. They replace their stand-ins.
void ViewVolume::Complete() {
  for (std::uint64_t number = 0; number < is_awaited_.size(); ++number) {
    if (is_awaited_[number]) Put(number, background_);
  }
  is_awaited_.clear();
}

void ViewVolume::Put(std::uint64_t number, BrickPtr brick) {
  if (IsAll(*brick, lattice_->Background())) brick = background_;
  if (brick == bricks_[number]) return;
  Count(number, false);
  bricks_[number] = std::move(brick);
  Count(number, true);
  ++version_;
  if (!is_changed_[number]) {
    is_changed_[number] = true;
    changes_.bricks.push_back(number);
  }
  TouchCellBricksAt(number);
}

void ViewVolume::Count(std::uint64_t number, bool add) {
  const Brick& brick = *bricks_[number];
  const Vec3i extent =
      ExtentWithin(BrickWithNumber(number, lattice_->BrickCounts()), lattice_->size);
  if (bricks_[number] == background_) {
    const auto times = static_cast<std::uint64_t>(extent.prod());
    add ? histogram_.Add(brick.front(), times) : histogram_.Remove(brick.front(), times);
    return;
  }
  if (extent == Vec3i::Constant(kBrickEdge)) {
    add ? histogram_.Add(brick) : histogram_.Remove(brick);
    return;
  }
  for (int i = 0; i < extent.x(); ++i) {
    for (int j = 0; j < extent.y(); ++j) {
      const std::span row(&brick[VoxelInBrick(i, j, 0)], static_cast<std::size_t>(extent.z()));
      add ? histogram_.Add(row) : histogram_.Remove(row);
    }
  }
}

void ViewVolume::TouchCellBricksAt(std::uint64_t number) {
  const Vec3i brick = BrickWithNumber(number, lattice_->BrickCounts());
  const Vec3i count = cell_brick_count();
  // The brick's last layer is also a layer of corners of the next cell brick.
  const Vec3i last = (brick + Vec3i::Ones()).cwiseMin(count - Vec3i::Ones());
  for (int a = brick.x(); a <= last.x(); ++a) {
    for (int b = brick.y(); b <= last.y(); ++b) {
      for (int c = brick.z(); c <= last.z(); ++c) {
        const std::uint64_t cell_brick = BrickNumber({a, b, c}, count);
        if (is_touched_[cell_brick]) continue;
        is_touched_[cell_brick] = true;
        touched_.push_back(cell_brick);
      }
    }
  }
}

void ViewVolume::UpdateCellRanges() {
  for (const std::uint64_t cell_brick : touched_) {
    is_touched_[cell_brick] = false;
    cell_ranges_[cell_brick] = RangeOfCellBrick(BrickWithNumber(cell_brick, cell_brick_count()));
  }
  touched_.clear();
}

ValueRange ViewVolume::RangeOfCellBrick(const Vec3i& cell_brick) const {
  const float background = lattice_->Background();
  std::optional<ValueRange> range;
  for (int n = 0; n < 8; ++n) {
    const Vec3i before(n >> 2, n >> 1 & 1, n & 1);
    const Vec3i brick = cell_brick - before;
    const Vec3i counts = lattice_->BrickCounts();
    ValueRange part{background, background};
    if ((brick.array() >= 0).all() && (brick.array() < counts.array()).all()) {
      const BrickPtr& values = bricks_[BrickNumber(brick, counts)];
      if (values != background_) part = RangeOfPart(*values, before * (kBrickEdge - 1));
    }
    if (!range) range = part;
    range->min = std::min(range->min, part.min);
    range->max = std::max(range->max, part.max);
  }
  return *range;
}

float ViewVolume::Value(const Vec3i& voxel) const {
  if ((voxel.array() < 0).any() || (voxel.array() >= lattice_->size.array()).any()) {
    return lattice_->Background();
  }
  const Vec3i brick = voxel / kBrickEdge;
  return At(
      BrickNumber(brick, lattice_->BrickCounts()))[VoxelInBrick(voxel.x(), voxel.y(), voxel.z())];
}

double ViewVolume::Interpolate(const Vec3& p_I) const {
  const bool is_within =
      (p_I.array() >= -1.0).all() && (p_I.array() <= lattice_->size.cast<double>().array()).all();
  if (!is_within) return lattice_->Background();
  const Vec3i last = lattice_->size - Vec3i::Ones();
  const Vec3i cell = p_I.array().floor().matrix().cast<int>().cwiseMin(last);
  CellDensities values;
  for (int v = 0; v < 8; ++v) {
    const auto& offset = kCornerOffset[v];
    values[v] = Value(cell + Vec3i(offset[0], offset[1], offset[2]));
  }
  return Trilinear(values).Value(p_I - cell.cast<double>());
}

Vec3i ViewVolume::cell_brick_count() const {
  if (!lattice_) return Vec3i::Zero();
  const Vec3i& size = lattice_->size;
  return {BrickCount(size.x() + 1), BrickCount(size.y() + 1), BrickCount(size.z() + 1)};
}

VolumeChanges ViewVolume::TakeChanges() {
  for (const std::uint64_t number : changes_.bricks) is_changed_[number] = false;
  VolumeChanges taken = std::exchange(changes_, {});
  if (taken.all) {
    std::erase_if(taken.bricks, [this](std::uint64_t n) { return bricks_[n] == background_; });
  }
  std::sort(taken.bricks.begin(), taken.bricks.end());
  return taken;
}

}  // namespace palpate::view
