// OpenVDB's filters (openvdb::tools::Filter) of a volume, as edits; those of whole volumes are in
// reshape.h.
//
// The result equals OpenVDB's own, bit by bit, on one grid in which every voxel of the lattice is
// active and the rest is the background (the least value of the range). Medians are OpenVDB's;
// means are computed in its order, but not in a tree, which takes ten times as long. Then results
// are held within the range and -0 becomes 0, as in edits. A region says which voxels are replaced;
// what they become is read from all voxels around.
//
// The volume is filtered in parts, each with as many voxels around it as its result can reach. So
// progress and cancelling are prompt, and after an edit only the parts near it are filtered again.
//
// Frames: as edit.h. Values in data units.
// Threads: one at a time per run; one processor, on the caller's thread: the others are for the
// servo and the clients. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "server/volume/edit.h"

namespace palpate {

enum class FilterKind {
  kGaussian,  // four means after each other
  kMean,      // of the (2·width + 1)³ voxels around each voxel
  kMedian,    // of the same voxels
  // Of whole volumes:
  kOffset,         // of a level set's surface, outwards
  kMeanCurvature,  // flow that smooths a level set's surface
  kResample,       // to another spacing
};

struct VolumeFilter {
  FilterKind kind = FilterKind::kGaussian;
  int width = 1;  // of the first three
  int iterations = 1;
  double distance_mm = 0.0;        // of an offset; inwards where negative
  Vec3 spacing_mm = Vec3::Zero();  // to resample to
  // None: all voxels. No falloff.
  std::variant<std::monostate, SphereShape, BoxShape> region{};
  EditFrame frame = EditFrame::kIndex;  // of the region
};

inline constexpr int kMostFilterWidth = 8;
// The farthest voxel that a result may depend on, along an axis. It bounds what one part of the
// volume takes: 192³ voxels in two buffers, 54 MiB.
inline constexpr int kMostFilterReach = 32;

// The farthest voxel that a result depends on, along an axis: width · iterations, of a gaussian
// four times as much.
std::int64_t FilterReach(const VolumeFilter& filter);

using FilterProgress = std::function<void(double fraction)>;
using FilterCancelled = std::function<bool()>;

// A filter at work. It follows a volume that is edited meanwhile: MoveTo, Compute, and again.
class FilterRun {
 public:
  // kInvalidArgument: a width, a reach or a region that is not possible.
  FilterRun(std::shared_ptr<const VolumeSnapshot> volume, const VolumeFilter& filter);
  ~FilterRun();
  FilterRun(const FilterRun&) = delete;
  FilterRun& operator=(const FilterRun&) = delete;

  // Another state of the same volume. Parts that read what differs are to be computed again.
  void MoveTo(std::shared_ptr<const VolumeSnapshot> volume);

  // Filters what is left. kCancelled: `cancelled` said so; Compute can be called again.
  void Compute(const FilterProgress& progress, const FilterCancelled& cancelled);

  // How long Compute would take, judged by how long it took so far; 0: nothing is left.
  double SecondsLeft() const;

  // The most memory that the new leaves take, and what Compute takes beside them.
  std::uint64_t MostBytes() const;
  std::uint64_t WorkBytes() const;

  const VolumeSnapshot& volume() const { return *volume_; }
  // What makes volume() the filtered one. Nothing may be left.
  EditResult Result() const;

 private:
  // Bricks min .. max, both included.
  struct BrickBox {
    Vec3i min = Vec3i::Zero();
    Vec3i max = Vec3i::Constant(-1);
    bool empty() const { return (min.array() > max.array()).any(); }
    bool Contains(const Vec3i& p) const {
      return (p.array() >= min.array()).all() && (p.array() <= max.array()).all();
    }
    BrickBox And(const BrickBox& other) const {
      return {min.cwiseMax(other.min), max.cwiseMin(other.max)};
    }
  };
  struct Part {
    BrickBox bricks;
    BrickBox left;  // to compute
    EditResult result;
  };
  class Worker;

  // All the voxels that the results of these bricks depend on, cut at the lattice.
  VoxelBox ReadBy(const BrickBox& bricks) const;
  double VoxelsReadBy(const BrickBox& bricks) const;
  double VoxelsLeft() const;

  std::shared_ptr<const VolumeSnapshot> volume_;
  const VolumeFilter filter_;
  int reach_ = 0;
  std::optional<VolumeEdit> region_;  // its shape and frame; none: all voxels
  VoxelBox voxels_;                   // around the region
  BrickBox bricks_;                   // the same; empty: no voxel is in the region
  int part_edge_ = 0;                 // bricks
  Vec3i part_count_ = Vec3i::Zero();
  std::vector<Part> parts_;   // as voxels in a brick: z fastest
  double seconds_ = 0.0;      // that Compute took, for
  double voxels_done_ = 0.0;  // so many voxels, those around included
};

// The same at once.
EditResult ApplyFilter(std::shared_ptr<const VolumeSnapshot> volume, const VolumeFilter& filter);

}  // namespace palpate
