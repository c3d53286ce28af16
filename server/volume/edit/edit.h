// Changes voxels by shapes, as palpate.v1.EditVolumeRequest explains.
//
// The weight of a voxel is 1 within the shape. Outside, it falls to 0 over the distance `falloff`,
// as a smoothstep. Results are clamped to the metadata's EditRange(). Voxels beyond the lattice
// never change.
//
// Frames: W (mm) or I (voxels), as the edit says. Distances are in this frame, whatever spacing and
// direction the volume has. Values in data units.
// Threads: pure; any. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <variant>
#include <vector>

#include "common/contract/edit.h"
#include "common/contract/enumerations.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Voxels min .. min + size - 1, with one value each, x fastest. Always in the frame I, without
// falloff.
struct DenseBlock {
  Eigen::Matrix<std::int64_t, 3, 1> min = Eigen::Matrix<std::int64_t, 3, 1>::Zero();
  Eigen::Matrix<std::int64_t, 3, 1> size = Eigen::Matrix<std::int64_t, 3, 1>::Zero();
  std::vector<float> values{};
};

struct VolumeEdit {
  std::variant<SphereShape, BoxShape, CapsuleShape, DenseBlock> shape{};
  EditFrame frame = EditFrame::kIndex;
  EditOperation operation = EditOperation::kSet;
  double value = 0.0;     // not used by smooth, nor by a block
  double strength = 1.0;  // in (0, 1]; only for smooth and paint
  double falloff = 0.0;   // in the frame's unit
};

struct EditResult {
  std::vector<BrickChange> changes{};  // the bricks in which a value changed
  std::optional<IndexBox> changed{};   // the box around the changed voxels
  std::uint64_t changed_voxels = 0;
};

// The most voxels that one edit may visit at once: it then takes less than a second.
inline constexpr std::int64_t kMostEditedVoxels = std::int64_t{1} << 24;

// What an edit tells and asks. An exception from any of these ends the edit.
struct EditCalls {
  // Called with the box around the edit's region before a brick is made.
  std::function<void(const IndexBox& box)> box_known{};
  // Called with the share that is done, up to once for each layer of bricks. With it, an edit may
  // visit any number of voxels.
  std::function<void(double share)> progress{};
};

// Returns the changes that `edit` makes to `volume`; `volume` itself does not change. Smoothing
// reads only the state before the edit. Its means leave out voxels beyond the lattice.
// Throws:
//   kInvalidArgument  a number is not finite, the shape has no extent, or the region or a value is
//                     outside the volume's
//   kTooLarge         more than kMostEditedVoxels in the box around the region, without `progress`
EditResult ApplyEdit(const VolumeSnapshot& volume, const VolumeEdit& edit,
                     const EditCalls& calls = {});

// As ApplyEdit, for an edit of a stroke that acts once on each voxel. `before` is the volume before
// the stroke, on the same lattice. A voxel changes from its value there, by the largest weight that
// the stroke's edits have had for it. All edits of a stroke have the same operation and value.
// Results are clamped to the range of values at load; a value beyond it does not move outwards.
EditResult ApplyEditOnce(const VolumeSnapshot& before, const VolumeSnapshot& volume,
                         const VolumeEdit& edit, const EditCalls& calls = {});

// The most memory that new bricks for all voxels of the box take.
std::uint64_t MostBrickBytes(const IndexBox& box);

// Returns the result for bricks that already exist. Leaves out bricks in which no value differs.
EditResult CompareBricks(const VolumeSnapshot& volume, const std::vector<BrickChange>& changes);

}  // namespace palpate
