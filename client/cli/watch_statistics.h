// Figures of the loop from a stream of samples: rates, update times, checks.
//
// Pure: the caller passes the time. `now_ns` is CLOCK_MONOTONIC of this machine. Times in samples
// are CLOCK_MONOTONIC of the daemon's machine.
// Threads: one.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "client/sdk/pose.h"

namespace palpate::cli {

// The share of `part` in part + rest; 0 of nothing.
double Percent(std::uint64_t part, std::uint64_t rest);

struct UpdateTime {
  double mean_us = 0.0;
  double p99_us = 0.0;
  double max_us = 0.0;
};

// Counted since watching began, unless stated otherwise.
struct WatchFigures {
  double seconds = 0.0;
  std::uint64_t samples = 0;
  std::uint64_t contact_samples = 0;
  // Samples whose density exceeds the isovalue, except while ejecting or inside. Always 0 if the
  // proxy works as promised.
  std::uint64_t inside_samples = 0;
  std::uint64_t dropped_samples = 0;
  // From the first sample to the last: executed ticks, missed ticks, and ticks per second of the
  // loop's clock.
  std::uint64_t ticks = 0;
  std::uint64_t missed_ticks = 0;
  double ticks_per_s = 0.0;
  double missed_per_s = 0.0;
  double missed_percent = 0.0;
  UpdateTime update;

  // Over the last kWindowSeconds.
  double recent_samples_per_s = 0.0;
  double recent_ticks_per_s = 0.0;
  double recent_missed_per_s = 0.0;
  UpdateTime recent_update;

  // Since the daemon started.
  std::uint64_t total_missed_ticks = 0;
  double total_missed_percent = 0.0;

  // The age of the newest sample. If the daemon runs on another machine, the clocks differ: the
  // shortest delay of any message is then subtracted.
  double age_ms = 0.0;
};

class WatchStatistics {
 public:
  static constexpr double kWindowSeconds = 3.0;

  // `shares_clock`: the daemon runs on this machine.
  WatchStatistics(std::int64_t now_ns, bool shares_clock);

  // Counts the samples of one new message.
  void Add(const client::PoseBatch& batch, std::int64_t now_ns);

  WatchFigures Figures(std::int64_t now_ns) const;

 private:
  struct Tick {
    std::uint64_t tick = 0;
    std::uint64_t missed_ticks = 0;
    std::int64_t time_ns = 0;
    std::int64_t update_ns = 0;
  };
  struct Arrival {
    std::int64_t now_ns = 0;
    std::size_t samples = 0;
  };

  void AddSample(const client::Pose& pose);
  void ForgetOld(std::int64_t now_ns);

  const std::int64_t start_ns_;
  const bool shares_clock_;
  std::int64_t least_delay_ns_ = 0;
  WatchFigures counts_;
  Tick first_;
  Tick last_;
  // The samples and messages of the window, oldest first.
  std::deque<Tick> recent_ticks_;
  std::deque<Arrival> recent_arrivals_;
  // Update times in bins of 100 ns. The last bin also holds all longer times.
  std::vector<std::uint64_t> histogram_;
  double update_sum_ns_ = 0.0;
};

}  // namespace palpate::cli
