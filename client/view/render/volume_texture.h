// A volume on the graphics card: its voxels, and the range of values of each cell brick. With the
// ranges, a ray skips what it cannot hit.
//
// Layout: texel (k + 1, j + 1, i + 1) of `voxels` (R32F) is voxel (i, j, k). The layer around the
// lattice is the background. All values are scaled by scale(). Texel (c, b, a) of `ranges` (RG32F)
// is cell brick (a, b, c) of ViewVolume. The range includes all values that the texture has at the
// corners of that brick. Ranges are uploaded together with the voxels, so that a picture of a
// partly uploaded volume shows the uploaded part.
//
// Threads: that of the current OpenGL 4.3 context. Its state must be as ResetState leaves it.
// Errors: kTooLarge for a volume that the card does not hold. It is thrown once; there is no
// texture then until another volume begins.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "client/view/render/value_scale.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

class VolumeTexture {
 public:
  VolumeTexture() = default;
  ~VolumeTexture();
  VolumeTexture(const VolumeTexture&) = delete;
  VolumeTexture& operator=(const VolumeTexture&) = delete;

  // Uploads at most `most_bricks` changed bricks. Returns true if none is left. `volume` must
  // always be the same object.
  bool TakeUp(ViewVolume& volume, std::size_t most_bricks);
  // The changed bricks that the last TakeUp left.
  std::size_t waiting_bricks() const { return waiting_.size(); }

  // 0 before a volume began.
  unsigned voxels() const { return voxels_; }
  unsigned ranges() const { return ranges_; }
  const Vec3i& size() const { return size_; }  // of the lattice, voxels
  const Vec3i& cell_brick_count() const { return cell_brick_count_; }
  const ValueScale& scale() const { return scale_; }  // maps values to texels
  double value_min() const { return value_min_; }
  double value_max() const { return value_max_; }
  const std::optional<AffineMap>& X_DI() const { return X_DI_; }
  // Rises whenever a picture of the volume may look different.
  std::uint64_t version() const { return version_; }

 private:
  void Begin(const ViewVolume& volume);
  void Release();
  void TakeUpPlacement(const ViewVolume& volume);
  void Await(std::span<const std::uint64_t> bricks);
  void UploadBrick(const Brick& brick, std::uint64_t number);
  void WidenRangesAt(std::uint64_t number, const ViewVolume& volume);
  bool IsWaitingAt(const Vec3i& cell_brick) const;
  void UploadRanges();

  unsigned voxels_ = 0;
  unsigned ranges_ = 0;
  Vec3i size_ = Vec3i::Zero();
  Vec3i cell_brick_count_ = Vec3i::Zero();
  ValueScale scale_;
  double value_min_ = 0.0;
  double value_max_ = 1.0;
  std::optional<AffineMap> X_DI_;
  std::uint64_t version_ = 0;

  std::deque<std::uint64_t> waiting_;          // changed bricks that are not on the card yet
  std::vector<bool> is_waiting_;               // by number of the brick
  std::vector<ValueRange> held_ranges_;        // on the card, by number of the cell brick
  std::vector<std::uint64_t> changed_ranges_;  // not on the card yet
};

}  // namespace palpate::view
