#include "client/view/volume/histogram.h"

#include <cmath>

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

void Histogram::Add(std::span<const float> values) {
  for (const float value : values) ++counts_[BinOf(value)];
}

void Histogram::Remove(std::span<const float> values) {
  for (const float value : values) --counts_[BinOf(value)];
}

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

}  // namespace palpate::view
