// Changes of voxels by shapes, as palpate.v1.EditVolumeRequest explains them.
//
// The weight of a voxel is 1 within the shape and falls, as a smoothstep, to 0 over
// the distance `falloff` outside of it. Results are held within the range of the
// metadata. Voxels beyond the lattice are never touched.
//
// Frames: W (mm) or I (voxels), as the edit says; distances are those of its frame,
// whatever spacing and direction the volume has. Values in data units.
// Threads: pure; any. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <variant>
#include <vector>

#include "server/volume/snapshot.h"

namespace palpate {

enum class EditFrame { kWorld, kIndex };

enum class EditOperation {
  kAdd,       // v + w·value
  kSubtract,  // v - w·value
  kSet,       // v + w·(value - v); exactly the value where w is 1
  kSmooth,    // v + w·strength·(m - v), m the mean of the 27 voxels around
  kPaint,     // v + w·strength·(value - v)
};

struct SphereShape {
  Vec3 center = Vec3::Zero();
  double radius = 0.0;
};

// Along the frame's axes, corners included.
struct BoxShape {
  Vec3 min = Vec3::Zero();
  Vec3 max = Vec3::Zero();
};

// What a sphere sweeps on a straight way.
struct CapsuleShape {
  Vec3 from = Vec3::Zero();
  Vec3 to = Vec3::Zero();
  double radius = 0.0;
};

// Voxels min .. min + size - 1 with a value each, x fastest; always of I, without
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
  double value = 0.0;     // not for smooth, nor for a block
  double strength = 1.0;  // in (0, 1]; for smooth and paint
  double falloff = 0.0;   // in the frame's unit
};

// Voxels min .. max, both included.
struct VoxelBox {
  Vec3i min = Vec3i::Zero();
  Vec3i max = Vec3i::Zero();
};

struct EditResult {
  std::vector<BrickChange> changes{};  // of the bricks in which a value changed
  std::optional<VoxelBox> changed{};   // around the voxels that changed
  std::uint64_t changed_voxels = 0;
};

// Voxels that one edit may look at.
inline constexpr std::int64_t kMostEditedVoxels = std::int64_t{1} << 24;

// The changes that `edit` makes to `volume`, which stays as it is. Smoothing reads
// nothing but that state; its means leave out what lies beyond the lattice.
// kInvalidArgument: not finite, no extent, a region or a value outside of the
// volume's; kTooLarge: more than kMostEditedVoxels in the box around the region.
// `box_known`: told of that box before a brick is made; what it throws ends the edit.
EditResult ApplyEdit(const VolumeSnapshot& volume, const VolumeEdit& edit,
                     const std::function<void(const VoxelBox& box)>& box_known = {});

// The most memory that other bricks for all voxels of the box take.
std::uint64_t MostBrickBytes(const VoxelBox& box);

// The same result for bricks that are already made. Those that differ in no value
// are left out.
EditResult CompareBricks(const VolumeSnapshot& volume, const std::vector<BrickChange>& changes);

}  // namespace palpate
