// OpenVDB's filters (openvdb::tools::Filter) of a volume, as edits. reshape.h has the filters of
// whole volumes.
//
// The result equals OpenVDB's own, bit by bit, on a grid in which every voxel of the lattice is
// active and the rest is the background (the least value of the range). Medians are computed by
// OpenVDB. Means are computed in OpenVDB's order, but not in a tree, which would take ten times as
// long. Then results are clamped to the range, and -0 becomes 0, as in edits. A region says which
// voxels are replaced; their new values are computed from all voxels around them.
//
// The volume is filtered in parts. Each part reads as many voxels around it as its result depends
// on. So progress and cancelling are prompt, and after an edit only the parts near it are filtered
// again.
//
// Frames: as edit.h. Values in data units.
// Threads: one at a time per run. Uses one processor, on the caller's thread; the others are for
// the servo and the clients. Not for real-time code. Errors: Error.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "server/volume/edit/edit.h"

namespace palpate {

struct VolumeFilter {
  FilterKind kind = FilterKind::kGaussian;
  int width = 1;  // for the first three kinds
  int iterations = 1;
  double distance_mm = 0.0;        // for kOffset; negative: inwards
  Vec3 spacing_mm = Vec3::Zero();  // for kResample: the new spacing
  // The region, without falloff; none: all voxels.
  std::variant<std::monostate, SphereShape, BoxShape> region{};
  EditFrame frame = EditFrame::kIndex;  // the region's frame
};

inline constexpr int kMostFilterWidth = 8;
// The largest allowed reach of a result, in voxels along an axis. It limits the memory of one part
// of the volume: 192³ voxels in two buffers, 54 MiB.
inline constexpr int kMostFilterReach = 32;

using FilterProgress = std::function<void(double fraction)>;
using FilterCancelled = std::function<bool()>;

// A running filter. If the volume is edited in the meantime, call MoveTo and Compute again.
class FilterRun {
 public:
  // Throws kInvalidArgument for an impossible width, reach or region.
  FilterRun(std::shared_ptr<const VolumeSnapshot> volume, const VolumeFilter& filter);
  ~FilterRun();
  FilterRun(const FilterRun&) = delete;
  FilterRun& operator=(const FilterRun&) = delete;

  // Moves to another state of the same volume. Parts that depend on changed voxels must be computed
  // again.
  void MoveTo(std::shared_ptr<const VolumeSnapshot> volume);

  // Filters the remaining parts. Throws kCancelled if `cancelled` returns true; Compute can be
  // called again then.
  void Compute(const FilterProgress& progress, const FilterCancelled& cancelled);

  // Estimates the time that Compute will take, from the time so far; 0: nothing remains.
  double SecondsLeft() const;

  // The most memory that the new leaves take, and the memory that Compute takes besides.
  std::uint64_t MostBytes() const;
  std::uint64_t WorkBytes() const;

  const VolumeSnapshot& volume() const { return *volume_; }
  // Returns the changes that turn volume() into the filtered volume. All parts must be computed.
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
    BrickBox left;  // the bricks still to compute
    EditResult result;
  };
  class Worker;

  // All voxels that the results of these bricks depend on, within the lattice.
  IndexBox ReadBy(const BrickBox& bricks) const;
  double VoxelsReadBy(const BrickBox& bricks) const;
  double VoxelsLeft() const;

  std::shared_ptr<const VolumeSnapshot> volume_;
  const VolumeFilter filter_;
  int reach_ = 0;
  std::optional<VolumeEdit> region_;  // the region's shape and frame; none: all voxels
  IndexBox voxels_;                   // the box around the region
  BrickBox bricks_;                   // the bricks of this box; empty: no voxel is in the region
  int part_edge_ = 0;                 // bricks
  Vec3i part_count_ = Vec3i::Zero();
  std::vector<Part> parts_;   // ordered like voxels in a brick: z fastest
  double seconds_ = 0.0;      // the time that Compute took so far
  double voxels_done_ = 0.0;  // the voxels filtered in this time, with the voxels around them
};

// Runs the whole filter at once.
EditResult ApplyFilter(std::shared_ptr<const VolumeSnapshot> volume, const VolumeFilter& filter);

}  // namespace palpate
