// The viewer's copy of the volume: bricks shared with the client library, with additional data for
// a ray caster and a slider.
//
// One virtual layer of the background surrounds the lattice, as for the proxy, so that the surface
// is closed there. A cell brick holds 8³ cells of this padded lattice: cell brick (a, b, c) has the
// cells (8a - 1 .. 8a + 6, ...), and their corners are the voxels (8a - 1 .. 8a + 7, ...). A cell
// block holds 8³ cell bricks. Its number is (a nb + b) nc + c. Within it, the place of a cell brick
// is that of a voxel in a brick (brick.h).
//
// Memory and time follow the bricks that vary, not the box.
//
// Frames: I voxel indices, W volume (mm), D device (mm). Values in data units.
// Threads: one at a time. Errors: none; client/sdk has checked the updates.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "client/sdk/volume_update.h"
#include "common/bricks/typed_brick.h"

namespace palpate::view {

// Counts how often values occur in a volume.
//
// Values in data units. Threads: plain values.
class Histogram {
 public:
  static constexpr int kBins = 256;

  Histogram() = default;
  // Equal bins over min .. max. Values outside count in the first and the last bin.
  Histogram(double min, double max);

  // Adds a value this many times. A negative number removes what was added before.
  void Add(float value, std::int64_t times) {
    counts_[BinOf(value)] += static_cast<std::uint64_t>(times);
  }

  int BinOf(float value) const {
    const double bin = (static_cast<double>(value) - min_) * bins_per_unit_;
    // Check first: the conversion must not exceed an int.
    if (!(bin > 0.0)) return 0;
    return bin < kBins - 1 ? static_cast<int>(bin) : kBins - 1;
  }

  double min() const { return min_; }
  double max() const { return max_; }
  const std::array<std::uint64_t, kBins>& counts() const { return counts_; }

  // The counts as bars. Whole numbers, also scaled ones, are spread evenly. If there are fewer of
  // them than bins, no number falls into some bins; then each number has a bar of its own.
  struct Bars {
    double first;  // the middle of the first bar
    double width;
    std::vector<std::uint64_t> counts;
  };
  Bars bars() const;

 private:
  // The fewest equal steps from min to max that reach all bins with counts; 0: as many as bins.
  int Steps() const;
  bool FitSteps(int steps) const;

  double min_ = 0.0;
  double max_ = 1.0;
  double bins_per_unit_ = kBins;
  std::array<std::uint64_t, kBins> counts_{};
};

// Counts voxels of integer types by value, and adds the sums to a histogram at the end: a voxel
// then costs one addition.
class VoxelCounts {
 public:
  explicit VoxelCounts(Histogram& histogram) : histogram_(histogram) {}
  ~VoxelCounts();
  VoxelCounts(const VoxelCounts&) = delete;
  VoxelCounts& operator=(const VoxelCounts&) = delete;

  // Adds (1) or removes (-1) the voxels of a brick before `end` along each axis.
  void Count(const TypedBrick& brick, const Vec3i& end, int sign);

 private:
  // From -2^15 to 2^16 - 1.
  static constexpr int kLeast = -(1 << 15);

  Histogram& histogram_;
  std::vector<std::int64_t> counts_;  // empty: no integers yet
};

struct ValueRange {
  float min = 0.0f;
  float max = 0.0f;
  bool IsOneValue() const { return min == max; }
  void Add(const ValueRange& other) {
    min = other.min < min ? other.min : min;
    max = other.max > max ? other.max : max;
  }
  friend bool operator==(const ValueRange&, const ValueRange&) = default;
};

// Cell bricks of a block, by place.
using CellBricks = std::bitset<kBrickVoxels>;

struct CellBlock {
  ValueRange range;  // at the corners of all cells
  // At the corners of each cell brick, by place. Null: the block has one value throughout.
  std::unique_ptr<std::array<ValueRange, kBrickVoxels>> bricks;
};

// The changes that the graphics card has to take up since it asked last.
struct VolumeChanges {
  struct Block {
    std::uint64_t number = 0;
    CellBricks bricks;  // whose values may have changed
  };
  // Another lattice: everything of the old one is void. Blocks that are not in `blocks` are the
  // background throughout.
  bool all = false;
  std::vector<Block> blocks{};  // ascending
};

class ViewVolume {
 public:
  void Take(const client::VolumeUpdate& update);

  // None before a volume began.
  const std::optional<VolumeLattice>& lattice() const { return lattice_; }
  // The volume's place; none before it is known.
  const std::optional<AffineMap>& X_DI() const { return X_DI_; }
  // The place of the frame W, in which the volume's file gives positions (mm); none before lattice
  // and place are known.
  std::optional<AffineMap> X_DW() const;
  // Where the axes of W point in the patient, and who says so: see VolumePlacement.
  const std::string& patient_axes() const { return patient_axes_; }
  bool axes_are_answered() const { return axes_are_answered_; }
  // Bricks still to come, as far as is known; 0: complete. Until then the overview's means or the
  // background stand in for them.
  std::uint64_t bricks_left() const { return bricks_left_; }
  // True if the overview's means stand in for bricks that are still to come.
  bool has_overview() const { return !overview_.empty(); }
  // The daemon's revision that this copy equals, voxel by voxel; none while bricks are still to
  // come.
  const std::optional<VolumeRevision>& revision() const { return revision_; }

  // Call the following functions only with a lattice.

  // The background stands for bricks that have not come.
  const BrickMap& bricks() const { return *bricks_; }
  // Returns the background outside of the lattice. Where a brick has not come, it returns the
  // overview's mean; in a volume of integers the mean is rounded.
  float Value(const Vec3i& voxel) const;
  // The trilinear interpolant; the background outside of the padded lattice.
  double Interpolate(const Vec3& p_I) const;

  Vec3i cell_brick_count() const;
  Vec3i cell_block_count() const;
  // By number.
  const std::vector<CellBlock>& cell_blocks() const { return blocks_; }
  const ValueRange& RangeOf(const Vec3i& cell_brick) const;
  // True if no mean of the overview stands in for any of its corners.
  bool HasCome(const Vec3i& cell_brick) const;

  // Of all voxels within the lattice. Bricks that have not come count as background.
  const Histogram& histogram() const { return histogram_; }

  // Rises with every change of voxels or lattice.
  std::uint64_t version() const { return version_; }
  VolumeChanges TakeChanges();

 private:
  void Begin(const std::optional<VolumeLattice>& lattice);
  // Uses blocks of means, as in VolumeUpdate, for bricks that are still to come.
  void ShowOverview(const Vec3i& size, std::vector<float> means);
  void Complete();
  // Bricks have come: no stand-ins any more.
  void Await(const std::vector<BrickRun>& came);
  bool IsAwaited(const Vec3i& brick) const;
  void TakeBlock(const BrickMap& old, const Vec3i& block, VoxelCounts& counts);
  void TouchCellsAt(const Vec3i& brick);
  void TouchCellsOfBlock(const Vec3i& block);
  void UpdateTouched();
  void UpdateBlock(const Vec3i& block, const CellBricks& bricks);
  std::optional<float> OneValueOf(const Vec3i& block) const;
  ValueRange RangeOfCellBrick(const Vec3i& cell_brick) const;
  ValueRange RangeOfMeans(const Vec3i& brick) const;
  float Mean(const Vec3i& voxel) const;

  std::optional<VolumeLattice> lattice_;
  std::optional<AffineMap> X_DI_;
  std::string patient_axes_;
  bool axes_are_answered_ = false;
  std::uint64_t bricks_left_ = 0;
  std::optional<VolumeRevision> revision_;
  std::shared_ptr<const BrickMap> bricks_;
  // By number of the brick, for volumes that may have an overview, until complete.
  std::vector<bool> is_awaited_;
  Vec3i overview_size_ = Vec3i::Zero();
  std::vector<float> overview_;          // empty: nothing stands in
  std::vector<ValueRange> mean_ranges_;  // of the means in each brick, by number
  std::vector<CellBlock> blocks_;
  std::unordered_map<std::uint64_t, CellBricks> touched_;  // whose ranges may have changed
  Histogram histogram_;
  std::uint64_t version_ = 0;

  bool all_changed_ = false;
  std::unordered_map<std::uint64_t, CellBricks> changed_;  // by number of the block
};

}  // namespace palpate::view
