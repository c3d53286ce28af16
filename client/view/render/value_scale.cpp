#include "client/view/render/value_scale.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::view {
namespace {

constexpr int kLargestExponent = 32;
constexpr double kMost = 0x1p50;

double FloatNotAbove(double value) {
  const auto nearest = static_cast<float>(value);
  if (nearest <= value) return nearest;
  return std::nextafter(nearest, -std::numeric_limits<float>::infinity());
}

}  // namespace

ValueScale::ValueScale(double min, double max) {
  const double largest = std::max(std::abs(min), std::abs(max));
  if (!(largest > 0.0) || !std::isfinite(largest)) return;
  factor_ = std::ldexp(1.0, kLargestExponent - std::ilogb(largest));
}

double ValueScale::Scaled(double value) const { return std::clamp(value * factor_, -kMost, kMost); }

Eigen::Vector2d ValueScale::Split(double value) const {
  const double scaled = Scaled(value);
  const double first = FloatNotAbove(scaled);
  return {first, FloatNotAbove(scaled - first)};
}

}  // namespace palpate::view
