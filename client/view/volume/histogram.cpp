#include "client/view/volume/histogram.h"

namespace palpate::view {

Histogram::Histogram(double min, double max)
    : min_(min), max_(max), bins_per_unit_(max > min ? kBins / (max - min) : 0.0) {}

void Histogram::Add(std::span<const float> values) {
  for (const float value : values) ++counts_[BinOf(value)];
}

void Histogram::Remove(std::span<const float> values) {
  for (const float value : values) --counts_[BinOf(value)];
}

}  // namespace palpate::view
