#include "client/view/window/run.h"

#include <fmt/core.h>

#include <algorithm>
#include <cstddef>
#include <span>

namespace palpate::view {
namespace {

// Returns the smallest value that is greater than this share of the values.
double Quantile(std::span<const double> values, double share) {
  std::vector<double> sorted(values.begin(), values.end());
  const auto at =
      sorted.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

std::string Ages(std::span<const double> ages_ms) {
  if (ages_ms.empty()) return "unknown";
  const std::size_t third = std::max<std::size_t>(1, ages_ms.size() / 3);
  return fmt::format(
      "{:.1f} ms, p99 {:.1f} ms, of the first third {:.1f} ms, of the last {:.1f} ms",
      Quantile(ages_ms, 0.5), Quantile(ages_ms, 0.99), Quantile(ages_ms.first(third), 0.5),
      Quantile(ages_ms.last(third), 0.5));
}

}  // namespace

void FrameLog::Add(const Viewer& viewer) {
  if (frames_++ == 0) {
    begin_ = Clock::now();
    casts_before_ = viewer.renderer().casts();
  }
  if (const auto age_ms = viewer.feed().stream_age_ms()) ages_ms_.push_back(*age_ms);
}

double FrameLog::seconds() const {
  return frames_ == 0 ? 0.0 : std::chrono::duration<double>(Clock::now() - begin_).count();
}

std::string FrameLog::Line(const Viewer& viewer) const {
  return fmt::format("{} frames in {:.2f} s, {} casts, {} poses dropped, stream age {}", frames_,
                     seconds(), viewer.renderer().casts() - casts_before_,
                     viewer.feed().dropped_poses(), Ages(ages_ms_));
}

}  // namespace palpate::view
