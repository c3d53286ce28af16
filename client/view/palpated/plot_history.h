// The data of the plots: the last 10 seconds of |F|, penetration (from the HIP to SCP_H, in
// contact) and the loop's health.
//
// Times are Pose::time_ns.
// Threads: one at a time. Holds at most kMost entries.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "client/sdk/pose.h"

namespace palpate::view {

enum class Plot { kForce_n, kPenetration_mm, kUpdate_us, kMissedTicks, kStreamAge_ms };
inline constexpr int kPlots = 5;

class PlotHistory {
 public:
  static constexpr std::int64_t kSpan_ns = 10'000'000'000;
  static constexpr std::size_t kMost = 1200;  // 10 s at 120 Hz

  // `age_ms`: the age of the pose when it came; negative: unknown, and drawn as 0. A pose that is
  // older than the one before is from another clock, and starts the history anew.
  void Add(const client::Pose& pose, double age_ms);
  // Drops what is more than the span older than this time.
  void EndAt(std::int64_t time_ns);

  // One time for each value.
  std::span<const std::int64_t> Times_ns() const { return times_ns_; }
  // Oldest first. Missed ticks are those since the sample before.
  std::span<const float> Values(Plot plot) const;
  float Newest(Plot plot) const;    // 0 if there is none
  float Greatest(Plot plot) const;  // 0 if there is none

 private:
  void Drop(std::size_t count);

  std::vector<std::int64_t> times_ns_;
  std::array<std::vector<float>, kPlots> values_;
  std::optional<std::uint64_t> missed_before_;  // ticks, as the pose before counted
};

// The end of an axis from 0 on which this value is visible: 1, 2 or 5 times a power of ten; 1 if
// there is no value above 0.
float AxisTop(float greatest);

}  // namespace palpate::view
