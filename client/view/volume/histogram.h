// Counts how often values occur in a volume.
//
// Values in data units. Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/bricks/typed_brick.h"

namespace palpate::view {

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

}  // namespace palpate::view
