#include "client/view/volume/view_volume.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include "common/isosurface/cell.h"

namespace palpate::view {
namespace {

// A value on the border of two bins is in one of them, as it was rounded.
constexpr double kRounding = 1e-3;

// Values 0 to `steps` are spread evenly over all bins: the first value in or after this bin.
int FirstValueIn(int bin, int steps) {
  const double value = static_cast<double>(bin) * steps / Histogram::kBins;
  return static_cast<int>(std::ceil(value - kRounding));
}

bool HasValue(int bin, int steps) {
  const double next = static_cast<double>(bin + 1) * steps / Histogram::kBins;
  return FirstValueIn(bin, steps) < next + kRounding;
}

}  // namespace

Histogram::Histogram(double min, double max)
    : min_(min), max_(max), bins_per_unit_(max > min ? kBins / (max - min) : 0.0) {}

Histogram::Bars Histogram::bars() const {
  const int steps = Steps();
  if (steps == 0) {
    const double width = (max_ - min_) / kBins;
    return {min_ + 0.5 * width, width, {counts_.begin(), counts_.end()}};
  }
  Bars bars{min_, (max_ - min_) / steps, std::vector<std::uint64_t>(steps + 1)};
  for (int bin = 0; bin < kBins; ++bin) {
    if (counts_[bin] > 0) bars.counts[FirstValueIn(bin, steps)] += counts_[bin];
  }
  return bars;
}

int Histogram::Steps() const {
  for (int steps = 1; steps < kBins - 1; ++steps) {
    if (FitSteps(steps)) return steps;
  }
  return 0;
}

bool Histogram::FitSteps(int steps) const {
  int last = -1;
  for (int bin = 0; bin < kBins; ++bin) {
    if (counts_[bin] == 0) continue;
    const int value = FirstValueIn(bin, steps);
    if (value == last || !HasValue(bin, steps)) return false;
    last = value;
  }
  return true;
}

VoxelCounts::~VoxelCounts() {
  for (std::size_t n = 0; n < counts_.size(); ++n) {
    const auto value = static_cast<float>(static_cast<int>(n) + kLeast);
    if (counts_[n] != 0) histogram_.Add(value, counts_[n]);
  }
}

void VoxelCounts::Count(const TypedBrick& brick, const Vec3i& end, int sign) {
  if (brick.is_constant()) {
    histogram_.Add(brick[0], sign * end.prod());
    return;
  }
  VisitType(brick.type(), [&](auto voxel) {
    using T = decltype(voxel);
    const T* const values = brick.values<T>();
    const auto count = [&](const T* row, int length) {
      if constexpr (std::is_same_v<T, float>) {
        for (int k = 0; k < length; ++k) histogram_.Add(row[k], sign);
      } else {
        if (counts_.empty()) counts_.resize((1 << 16) - kLeast);
        std::int64_t* const from_zero = counts_.data() - kLeast;
        for (int k = 0; k < length; ++k) from_zero[row[k]] += sign;
      }
    };
    if (end == Vec3i::Constant(kBrickEdge)) {
      count(values, kBrickVoxels);
      return;
    }
    for (int i = 0; i < end.x(); ++i) {
      for (int j = 0; j < end.y(); ++j) count(values + VoxelInBrick(i, j, 0), end.z());
    }
  });
}

namespace {

// Larger volumes have no overview: see volume_update.h.
constexpr std::uint64_t kMostVoxelsWithOverview = std::uint64_t{1} << 28;

constexpr int kBlockVoxels = kBrickEdge * kBrickEdge;  // along each axis

std::size_t PlaceOf(const Vec3i& cell_brick) {
  return VoxelInBrick(cell_brick.x(), cell_brick.y(), cell_brick.z());
}

Vec3i Shift(int n) { return {n >> 2, n >> 1 & 1, n & 1}; }

bool IsWithin(const Vec3i& at, const Vec3i& count) {
  return (at.array() >= 0).all() && (at.array() < count.array()).all();
}

// Returns how many voxels of a brick are within the lattice, along each axis.
Vec3i ExtentWithin(const Vec3i& brick, const Vec3i& lattice_size) {
  return (lattice_size - brick * kBrickEdge).cwiseMin(kBrickEdge);
}

bool AreSame(const TypedBrickPtr& a, const TypedBrickPtr& b) {
  return a == b || (a->is_constant() && b->is_constant() && (*a)[0] == (*b)[0]);
}

// The brick blocks of the runs, each once.
std::vector<Vec3i> BlocksOf(const std::vector<BrickRun>& runs, const BrickMap& bricks) {
  const Vec3i& count = bricks.block_count();
  std::vector<bool> is_found(count.cast<std::size_t>().prod(), false);
  std::vector<Vec3i> blocks;
  for (BrickRun run : runs) {
    while (run.count > 0) {
      const Vec3i brick = BrickWithNumber(run.first, bricks.brick_count());
      const Vec3i block = brick / kBrickEdge;
      const auto number = BrickNumber(block, count);
      if (!is_found[number]) blocks.push_back(block);
      is_found[number] = true;
      const int end = std::min((block.z() + 1) * kBrickEdge, bricks.brick_count().z());
      const auto part = std::min<std::uint64_t>(run.count, end - brick.z());
      run.first += part;
      run.count -= part;
    }
  }
  return blocks;
}

// All places, or only those of the lower layer along the axes where `shift` is 1.
CellBricks LowerLayers(const Vec3i& shift) {
  CellBricks places;
  for (std::size_t n = 0; n < kBrickVoxels; ++n) {
    const Vec3i at(static_cast<int>(n >> 6), n >> 3 & 7, n & 7);
    places[n] = at.cwiseProduct(shift) == Vec3i::Zero();
  }
  return places;
}

template <class T>
ValueRange RangeOfAll(const T* values) {
  if constexpr (std::is_same_v<T, float>) {
    const Eigen::Map<const Eigen::Array<float, kBrickVoxels, 1>> all(values);
    return {all.minCoeff(), all.maxCoeff()};
  } else {
    T least = values[0];
    T most = values[0];
    for (int n = 0; n < kBrickVoxels; ++n) {
      least = std::min(least, values[n]);
      most = std::max(most, values[n]);
    }
    return {static_cast<float>(least), static_cast<float>(most)};
  }
}

template <class T>
ValueRange RangeWithin(const T* values, const Vec3i& first, const Vec3i& end) {
  T least = values[VoxelInBrick(first.x(), first.y(), first.z())];
  T most = least;
  for (int i = first.x(); i < end.x(); ++i) {
    for (int j = first.y(); j < end.y(); ++j) {
      const T* const row = values + VoxelInBrick(i, j, 0);
      for (int k = first.z(); k < end.z(); ++k) {
        least = row[k] < least ? row[k] : least;
        most = row[k] > most ? row[k] : most;
      }
    }
  }
  return {static_cast<float>(least), static_cast<float>(most)};
}

// The range of a brick's voxels from `first` to before `end` along each axis.
ValueRange RangeOfPart(const TypedBrick& brick, const Vec3i& first, const Vec3i& end) {
  if (brick.is_constant()) return {brick[0], brick[0]};
  return VisitType(brick.type(), [&](auto voxel) {
    const auto* const values = brick.values<decltype(voxel)>();
    const bool is_all = first == Vec3i::Zero() && end == Vec3i::Constant(kBrickEdge);
    return is_all ? RangeOfAll(values) : RangeWithin(values, first, end);
  });
}

}  // namespace

void ViewVolume::Take(const client::VolumeUpdate& update) {
  if (update.all) Begin(update.lattice);
  revision_ = update.complete;
  X_DI_ = update.placement ? std::optional(update.placement->device_from_index) : std::nullopt;
  patient_axes_ = update.placement ? update.placement->patient_axes : "";
  axes_are_answered_ = update.placement && update.placement->patient_axes_answered;
  if (!lattice_) return;
  Await(update.changed);
  const auto old = std::exchange(bricks_, update.bricks);
  {
    VoxelCounts counts(histogram_);
    for (const Vec3i& block : BlocksOf(update.changed, *bricks_)) TakeBlock(*old, block, counts);
  }
  if (update.complete) {
    Complete();
  } else if (!update.overview.empty()) {
    ShowOverview(update.overview_size, update.overview);
  }
  // The library does not know the number of bricks before the first bricks have come.
  bricks_left_ = update.complete ? 0 : std::max<std::uint64_t>(update.bricks_left, 1);
  UpdateTouched();
}

std::optional<AffineMap> ViewVolume::X_DW() const {
  if (!lattice_ || !X_DI_) return std::nullopt;
  return *X_DI_ * lattice_->X_WI.Inverse();
}

void ViewVolume::Begin(const std::optional<VolumeLattice>& lattice) {
  lattice_ = lattice;
  ++version_;
  all_changed_ = true;
  changed_.clear();
  touched_.clear();
  bricks_.reset();
  blocks_.clear();
  is_awaited_.clear();
  overview_.clear();
  mean_ranges_.clear();
  bricks_left_ = 0;
  histogram_ = lattice_ ? Histogram(lattice_->value_min, lattice_->value_max) : Histogram();
  if (!lattice_) return;
  const float background = lattice_->Background();
  const auto voxels = lattice_->size.cast<std::uint64_t>().prod();
  histogram_.Add(background, voxels);
  bricks_ = std::make_shared<BrickMap>(lattice_->BrickCounts(),
                                       TypedBrick::Constant(LeafType::kFloat, background));
  if (voxels <= kMostVoxelsWithOverview) is_awaited_.assign(lattice_->Bricks(), true);
  blocks_.resize(cell_block_count().cast<std::size_t>().prod());
  for (CellBlock& block : blocks_) block.range = {background, background};
}

void ViewVolume::Await(const std::vector<BrickRun>& came) {
  if (is_awaited_.empty()) return;
  for (const BrickRun& run : came) {
    for (std::uint64_t number = run.first; number < run.end(); ++number) {
      if (!is_awaited_[number]) continue;
      is_awaited_[number] = false;
      if (!overview_.empty()) TouchCellsAt(BrickWithNumber(number, lattice_->BrickCounts()));
    }
  }
}

bool ViewVolume::IsAwaited(const Vec3i& brick) const {
  return !overview_.empty() && is_awaited_[BrickNumber(brick, lattice_->BrickCounts())];
}

void ViewVolume::ShowOverview(const Vec3i& size, std::vector<float> means) {
  if (is_awaited_.empty()) return;
  overview_size_ = size;
  overview_ = std::move(means);
  // The graphics card stores values in the volume's type.
  if (lattice_->type != LeafType::kFloat) {
    for (float& mean : overview_) mean = std::round(mean);
  }
  mean_ranges_.resize(lattice_->Bricks());
  for (std::uint64_t number = 0; number < mean_ranges_.size(); ++number) {
    mean_ranges_[number] = RangeOfMeans(BrickWithNumber(number, lattice_->BrickCounts()));
  }
  // It comes before the bricks: almost all cells change.
  for (std::uint64_t number = 0; number < blocks_.size(); ++number) touched_[number].set();
}

// Bricks that never came are background. They replace their stand-ins.
void ViewVolume::Complete() {
  const bool has_stand_ins = !overview_.empty();
  for (std::uint64_t number = 0; number < is_awaited_.size(); ++number) {
    if (has_stand_ins && is_awaited_[number])
      TouchCellsAt(BrickWithNumber(number, lattice_->BrickCounts()));
  }
  overview_ = {};
  mean_ranges_ = {};
  is_awaited_ = {};
}

void ViewVolume::TakeBlock(const BrickMap& old, const Vec3i& block, VoxelCounts& counts) {
  const Vec3i first = block * kBrickEdge;
  const TypedBrickPtr& was = old.Only(block);
  const TypedBrickPtr& is = bricks_->Only(block);
  if (was && is && was->is_constant() && is->is_constant()) {
    if (AreSame(was, is)) return;
    const Vec3i extent = (lattice_->size - first * kBrickEdge).cwiseMin(kBlockVoxels);
    counts.Count(*was, extent, -1);
    counts.Count(*is, extent, 1);
    TouchCellsOfBlock(block);
    return;
  }
  const Vec3i count = (lattice_->BrickCounts() - first).cwiseMin(kBrickEdge);
  for (int a = 0; a < count.x(); ++a) {
    for (int b = 0; b < count.y(); ++b) {
      for (int c = 0; c < count.z(); ++c) {
        const Vec3i brick = first + Vec3i(a, b, c);
        const TypedBrickPtr& before = old.At(brick);
        const TypedBrickPtr& now = bricks_->At(brick);
        if (AreSame(before, now)) continue;
        const Vec3i extent = ExtentWithin(brick, lattice_->size);
        counts.Count(*before, extent, -1);
        counts.Count(*now, extent, 1);
        TouchCellsAt(brick);
      }
    }
  }
}

// A brick's last layer is also a layer of corners of the next cell brick.
void ViewVolume::TouchCellsAt(const Vec3i& brick) {
  for (int n = 0; n < 8; ++n) {
    const Vec3i cell_brick = brick + Shift(n);
    if (!IsWithin(cell_brick, cell_brick_count())) continue;
    const Vec3i block = cell_brick / kBrickEdge;
    touched_[BrickNumber(block, cell_block_count())].set(PlaceOf(cell_brick));
  }
}

void ViewVolume::TouchCellsOfBlock(const Vec3i& block) {
  for (int n = 0; n < 8; ++n) {
    static const std::array<CellBricks, 8> kPlaces = [] {
      std::array<CellBricks, 8> places;
      for (int m = 0; m < 8; ++m) places[static_cast<std::size_t>(m)] = LowerLayers(Shift(m));
      return places;
    }();
    const Vec3i at = block + Shift(n);
    if (!IsWithin(at, cell_block_count())) continue;
    touched_[BrickNumber(at, cell_block_count())] |= kPlaces[static_cast<std::size_t>(n)];
  }
}

void ViewVolume::UpdateTouched() {
  if (!touched_.empty()) ++version_;
  for (const auto& [number, bricks] : touched_) {
    UpdateBlock(BrickWithNumber(number, cell_block_count()), bricks);
    changed_[number] |= bricks;
  }
  touched_.clear();
}

void ViewVolume::UpdateBlock(const Vec3i& at, const CellBricks& bricks) {
  CellBlock& block = blocks_[BrickNumber(at, cell_block_count())];
  if (const std::optional<float> value = OneValueOf(at)) {
    block = {{*value, *value}, nullptr};
    return;
  }
  if (!block.bricks) {
    block.bricks = std::make_unique<std::array<ValueRange, kBrickVoxels>>();
    block.bricks->fill(block.range);
  }
  const Vec3i first = at * kBrickEdge;
  const Vec3i count = (cell_brick_count() - first).cwiseMin(kBrickEdge);
  std::optional<ValueRange> whole;
  for (int a = 0; a < count.x(); ++a) {
    for (int b = 0; b < count.y(); ++b) {
      for (int c = 0; c < count.z(); ++c) {
        const std::size_t place = VoxelInBrick(a, b, c);
        ValueRange& range = (*block.bricks)[place];
        if (bricks[place]) range = RangeOfCellBrick(first + Vec3i(a, b, c));
        if (!whole) whole = range;
        whole->Add(range);
      }
    }
  }
  block.range = *whole;
  if (whole->IsOneValue()) block.bricks.reset();
}

// The value of all corners in a block, if that can be told from whole blocks of bricks.
std::optional<float> ViewVolume::OneValueOf(const Vec3i& block) const {
  if (!overview_.empty()) return {};
  const Vec3i last = (block + Vec3i::Ones()) * kBlockVoxels - Vec3i::Ones();
  const bool is_at_border =
      (block.array() == 0).any() || (last.array() >= lattice_->size.array()).any();
  std::optional<float> value;
  if (is_at_border) value = lattice_->Background();
  for (int n = 0; n < 8; ++n) {
    const Vec3i part = block - Shift(n);
    if (!IsWithin(part, bricks_->block_count())) continue;
    const TypedBrickPtr& only = bricks_->Only(part);
    if (!only || !only->is_constant() || (value && *value != (*only)[0])) return {};
    value = (*only)[0];
  }
  return value;
}

ValueRange ViewVolume::RangeOfCellBrick(const Vec3i& cell_brick) const {
  const float background = lattice_->Background();
  const Vec3i counts = lattice_->BrickCounts();
  std::optional<ValueRange> range;
  const auto add = [&](const ValueRange& part) {
    if (!range) range = part;
    range->Add(part);
  };
  for (int n = 0; n < 8; ++n) {
    const Vec3i brick = cell_brick - Shift(n);
    if (!IsWithin(brick, counts)) {
      add({background, background});
      continue;
    }
    const Vec3i extent = ExtentWithin(brick, lattice_->size);
    if (extent != Vec3i::Constant(kBrickEdge)) add({background, background});
    const Vec3i first = Shift(n) * (kBrickEdge - 1);
    add(IsAwaited(brick) ? mean_ranges_[BrickNumber(brick, counts)]
                         : RangeOfPart(*bricks_->At(brick), first, extent));
  }
  return *range;
}

// Of all means in a brick: at least what is needed.
ValueRange ViewVolume::RangeOfMeans(const Vec3i& brick) const {
  const Vec3i first = brick * kBrickEdge;
  ValueRange range{Mean(first), Mean(first)};
  for (int n = 1; n < 8; ++n) {
    const Vec3i voxel = first + Shift(n) * kOverviewEdge;
    if (IsWithin(voxel, lattice_->size)) range.Add({Mean(voxel), Mean(voxel)});
  }
  return range;
}

float ViewVolume::Mean(const Vec3i& voxel) const {
  return overview_[BrickNumber(voxel / kOverviewEdge, overview_size_)];
}

float ViewVolume::Value(const Vec3i& voxel) const {
  if (!IsWithin(voxel, lattice_->size)) return lattice_->Background();
  if (IsAwaited(voxel / kBrickEdge)) return Mean(voxel);
  return bricks_->Value(voxel.x(), voxel.y(), voxel.z());
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

Vec3i ViewVolume::cell_block_count() const {
  const Vec3i bricks = cell_brick_count();
  return {BrickCount(bricks.x()), BrickCount(bricks.y()), BrickCount(bricks.z())};
}

const ValueRange& ViewVolume::RangeOf(const Vec3i& cell_brick) const {
  const CellBlock& block = blocks_[BrickNumber(cell_brick / kBrickEdge, cell_block_count())];
  return block.bricks ? (*block.bricks)[PlaceOf(cell_brick)] : block.range;
}

bool ViewVolume::HasCome(const Vec3i& cell_brick) const {
  if (overview_.empty()) return true;
  for (int n = 0; n < 8; ++n) {
    const Vec3i brick = cell_brick - Shift(n);
    if (IsWithin(brick, lattice_->BrickCounts()) && IsAwaited(brick)) return false;
  }
  return true;
}

VolumeChanges ViewVolume::TakeChanges() {
  VolumeChanges taken{.all = std::exchange(all_changed_, false)};
  for (const auto& [number, bricks] : std::exchange(changed_, {})) {
    const CellBlock& block = blocks_[number];
    const bool is_background = !block.bricks && block.range.min == lattice_->Background();
    if (taken.all && is_background) continue;
    taken.blocks.push_back({number, bricks});
  }
  std::sort(taken.blocks.begin(), taken.blocks.end(),
            [](const auto& a, const auto& b) { return a.number < b.number; });
  return taken;
}

}  // namespace palpate::view
