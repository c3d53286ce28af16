// Counts how often values occur in a volume.
//
// Values in data units. Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::view {

class Histogram {
 public:
  static constexpr int kBins = 256;

  Histogram() = default;
  // Equal bins over min .. max. Values outside count in the first and the last bin.
  Histogram(double min, double max);

  void Add(std::span<const float> values);
  // Removes values that were added before.
  void Remove(std::span<const float> values);
  // Adds one value this many times.
  void Add(float value, std::uint64_t times) { counts_[BinOf(value)] += times; }
  void Remove(float value, std::uint64_t times) { counts_[BinOf(value)] -= times; }

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

}  // namespace palpate::view
