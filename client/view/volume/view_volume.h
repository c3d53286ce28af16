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
#include "client/view/volume/histogram.h"

namespace palpate::view {

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
