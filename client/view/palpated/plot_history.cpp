#include "client/view/palpated/plot_history.h"

#include <algorithm>
#include <cmath>

namespace palpate::view {

void PlotHistory::Add(const client::Pose& pose, double age_ms) {
  if (!times_ns_.empty() && pose.time_ns < times_ns_.back()) Drop(times_ns_.size());
  EndAt(pose.time_ns);
  if (times_ns_.size() == kMost) Drop(1);
  times_ns_.push_back(pose.time_ns);
  // A restarted daemon counts anew: then none were missed.
  const bool goes_on = missed_before_ && pose.missed_ticks >= *missed_before_;
  const std::uint64_t missed = goes_on ? pose.missed_ticks - *missed_before_ : 0;
  missed_before_ = pose.missed_ticks;
  const double penetration_mm = pose.contact ? (pose.hip_mm - pose.scp_h_mm).norm() : 0.0;
  const std::array<double, kPlots> newest = {pose.force_n.norm(), penetration_mm,
                                             1e-3 * static_cast<double>(pose.update_ns),
                                             static_cast<double>(missed), std::max(age_ms, 0.0)};
  for (int plot = 0; plot < kPlots; ++plot) {
    values_[plot].push_back(static_cast<float>(newest[plot]));
  }
}

void PlotHistory::EndAt(std::int64_t time_ns) {
  const auto kept = std::lower_bound(times_ns_.begin(), times_ns_.end(), time_ns - kSpan_ns);
  Drop(static_cast<std::size_t>(kept - times_ns_.begin()));
}

void PlotHistory::Drop(std::size_t count) {
  const auto n = static_cast<std::ptrdiff_t>(count);
  times_ns_.erase(times_ns_.begin(), times_ns_.begin() + n);
  for (std::vector<float>& values : values_) values.erase(values.begin(), values.begin() + n);
}

std::span<const float> PlotHistory::Values(Plot plot) const {
  return values_[static_cast<std::size_t>(plot)];
}

float PlotHistory::Newest(Plot plot) const {
  const std::span values = Values(plot);
  return values.empty() ? 0.0f : values.back();
}

float PlotHistory::Greatest(Plot plot) const {
  const std::span values = Values(plot);
  return values.empty() ? 0.0f : *std::max_element(values.begin(), values.end());
}

float AxisTop(float greatest) {
  if (!(greatest > 0.0f) || !std::isfinite(greatest)) return 1.0f;
  const float power = std::pow(10.0f, std::floor(std::log10(greatest)));
  for (const float times : {1.0f, 2.0f, 5.0f}) {
    if (greatest <= times * power) return times * power;
  }
  return 10.0f * power;
}

}  // namespace palpate::view
