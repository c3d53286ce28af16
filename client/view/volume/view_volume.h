// The viewer's copy of the volume: voxels from the client library, with additional data for a ray
// caster and a slider.
//
// One virtual layer of the background surrounds the lattice, as for the proxy, so that the surface
// is closed there. A cell brick holds 8³ cells of this padded lattice: cell brick (a, b, c) has the
// cells (8a - 1 .. 8a + 6, ...), and their corners are the voxels (8a - 1 .. 8a + 7, ...). Its
// number is (a nb + b) nc + c.
//
// Frames: I voxel indices, D device (mm). Values in data units.
// Threads: one at a time. Errors: none; client/sdk has checked the updates.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "client/sdk/volume_update.h"
#include "client/view/volume/histogram.h"

namespace palpate::view {

struct ValueRange {
  float min = 0.0f;
  float max = 0.0f;
};

// The changes that a texture has to upload since it asked last.
struct VolumeChanges {
  bool all = false;                     // another lattice: everything of the old one is void
  std::vector<std::uint64_t> bricks{};  // whose voxels changed, ascending; where all: those
                                        // that are not the background throughout
};

class ViewVolume {
 public:
  void Take(const client::VolumeUpdate& update);

  // None before a volume began.
  const std::optional<VolumeLattice>& lattice() const { return lattice_; }
  // The volume's place; none before it is known.
  const std::optional<AffineMap>& X_DI() const { return X_DI_; }
  // Bricks still to come, as far as is known; 0: complete. Until then the overview's means or the
  // background stand in for them.
  std::uint64_t bricks_left() const { return bricks_left_; }
  // The daemon's revision that this copy equals, voxel by voxel; none while bricks are still to
  // come.
  const std::optional<VolumeRevision>& revision() const { return revision_; }

  // Call the following functions only with a lattice. Number below lattice()->Bricks().
  const Brick& At(std::uint64_t number) const { return *bricks_[number]; }
  // Returns the background outside of the lattice.
  float Value(const Vec3i& voxel) const;
  // The trilinear interpolant; the background outside of the padded lattice.
  double Interpolate(const Vec3& p_I) const;

  Vec3i cell_brick_count() const;
  // The least and greatest value at the corners of each cell brick, by its number.
  std::span<const ValueRange> cell_ranges() const { return cell_ranges_; }

  // Of all voxels within the lattice, including stand-ins.
  const Histogram& histogram() const { return histogram_; }

  // Rises with every change of voxels or lattice.
  std::uint64_t version() const { return version_; }
  VolumeChanges TakeChanges();

 private:
  void Begin(const std::optional<VolumeLattice>& lattice);
  // Uses blocks of means, as in VolumeUpdate, for bricks that are still to come.
  void ShowOverview(const Vec3i& size, std::span<const float> means);
  void Complete();
  void Put(std::uint64_t number, BrickPtr brick);
  void Count(std::uint64_t number, bool add);
  void TouchCellBricksAt(std::uint64_t number);
  void UpdateCellRanges();
  ValueRange RangeOfCellBrick(const Vec3i& cell_brick) const;

  std::optional<VolumeLattice> lattice_;
  std::optional<AffineMap> X_DI_;
  std::uint64_t bricks_left_ = 0;
  std::optional<VolumeRevision> revision_;
  BrickPtr background_;           // shared by all bricks that are only background
  std::vector<BrickPtr> bricks_;  // by number
  std::vector<bool> is_awaited_;  // by number, until complete; then empty
  std::vector<ValueRange> cell_ranges_;
  std::vector<std::uint64_t> touched_;  // cell bricks whose range may have changed
  std::vector<bool> is_touched_;
  Histogram histogram_;
  std::uint64_t version_ = 0;

  VolumeChanges changes_;
  std::vector<bool> is_changed_;  // by number: in changes_.bricks
};

}  // namespace palpate::view
