#include "client/view/volume/histogram.h"

#include <cmath>
#include <type_traits>

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

}  // namespace palpate::view
