#include "client/cli/watch_statistics.h"

#include <algorithm>
#include <utility>

namespace palpate::cli {
namespace {

constexpr std::int64_t kBinNs = 100;
constexpr std::size_t kBins = 50'000;  // up to 5 ms
constexpr auto kWindowNs = static_cast<std::int64_t>(WatchStatistics::kWindowSeconds * 1e9);

double PerSecond(std::uint64_t count, std::int64_t span_ns) {
  return span_ns > 0 ? static_cast<double>(count) * 1e9 / static_cast<double>(span_ns) : 0.0;
}

// Index of the 99th percentile among `count` sorted values.
std::uint64_t P99Index(std::uint64_t count) { return (count - 1) * 99 / 100; }

UpdateTime Summarise(std::vector<std::int64_t> update_ns) {
  UpdateTime result;
  if (update_ns.empty()) {
    return result;
  }
  double sum_ns = 0.0;
  for (const std::int64_t value : update_ns) {
    sum_ns += static_cast<double>(value);
  }
  result.mean_us = sum_ns * 1e-3 / static_cast<double>(update_ns.size());
  result.max_us = static_cast<double>(*std::max_element(update_ns.begin(), update_ns.end())) * 1e-3;
  const auto p99 = update_ns.begin() + static_cast<std::ptrdiff_t>(P99Index(update_ns.size()));
  std::nth_element(update_ns.begin(), p99, update_ns.end());
  result.p99_us = static_cast<double>(*p99) * 1e-3;
  return result;
}

// Returns the upper edge of the bin that holds the 99th percentile.
double HistogramP99Us(const std::vector<std::uint64_t>& histogram, std::uint64_t count) {
  std::uint64_t left = P99Index(count) + 1;
  std::size_t bin = 0;
  while (bin + 1 < histogram.size() && histogram[bin] < left) {
    left -= histogram[bin];
    ++bin;
  }
  return static_cast<double>((static_cast<std::int64_t>(bin) + 1) * kBinNs) * 1e-3;
}

}  // namespace

double Percent(std::uint64_t part, std::uint64_t rest) {
  const double whole = static_cast<double>(part) + static_cast<double>(rest);
  return whole > 0.0 ? 100.0 * static_cast<double>(part) / whole : 0.0;
}

WatchStatistics::WatchStatistics(std::int64_t now_ns, bool shares_clock)
    : start_ns_(now_ns), shares_clock_(shares_clock), histogram_(kBins) {}

void WatchStatistics::Add(const client::PoseBatch& batch, std::int64_t now_ns) {
  const std::int64_t delay_ns = now_ns - batch.sent_time_ns;
  const bool is_first = counts_.samples == 0;
  least_delay_ns_ = is_first ? delay_ns : std::min(least_delay_ns_, delay_ns);
  counts_.dropped_samples = batch.dropped;
  for (const client::Pose& pose : batch.poses) AddSample(pose);
  recent_arrivals_.push_back({now_ns, batch.poses.size()});
  ForgetOld(now_ns);
}

// True if the proxy is inside the surface, where it must never be.
bool IsInside(const client::Pose& pose) {
  if (pose.mode != client::ProxyMode::kFree && pose.mode != client::ProxyMode::kConstrained) {
    return false;
  }
  return pose.free_side == client::FreeSide::kAbove ? pose.density < pose.isovalue
                                                    : pose.density > pose.isovalue;
}

void WatchStatistics::AddSample(const client::Pose& pose) {
  last_ = {pose.tick, pose.missed_ticks, pose.time_ns, pose.update_ns};
  if (counts_.samples == 0) {
    first_ = last_;
  }
  ++counts_.samples;
  counts_.contact_samples += pose.contact ? 1 : 0;
  counts_.inside_samples += IsInside(pose) ? 1 : 0;
  const auto bin = static_cast<std::size_t>(std::max<std::int64_t>(pose.update_ns, 0) / kBinNs);
  ++histogram_[std::min(bin, kBins - 1)];
  update_sum_ns_ += static_cast<double>(pose.update_ns);
  counts_.update.max_us =
      std::max(counts_.update.max_us, static_cast<double>(pose.update_ns) * 1e-3);
  recent_ticks_.push_back(last_);
}

void WatchStatistics::ForgetOld(std::int64_t now_ns) {
  while (!recent_ticks_.empty() && recent_ticks_.front().time_ns < last_.time_ns - kWindowNs) {
    recent_ticks_.pop_front();
  }
  while (!recent_arrivals_.empty() && recent_arrivals_.front().now_ns < now_ns - kWindowNs) {
    recent_arrivals_.pop_front();
  }
}

WatchFigures WatchStatistics::Figures(std::int64_t now_ns) const {
  WatchFigures figures = counts_;
  figures.seconds = static_cast<double>(now_ns - start_ns_) * 1e-9;
  if (figures.samples == 0) {
    return figures;
  }
  const std::int64_t span_ns = last_.time_ns - first_.time_ns;
  figures.ticks = last_.tick - first_.tick;
  figures.missed_ticks = last_.missed_ticks - first_.missed_ticks;
  figures.ticks_per_s = PerSecond(figures.ticks, span_ns);
  figures.missed_per_s = PerSecond(figures.missed_ticks, span_ns);
  figures.missed_percent = Percent(figures.missed_ticks, figures.ticks);
  figures.update.mean_us = update_sum_ns_ * 1e-3 / static_cast<double>(figures.samples);
  figures.update.p99_us =
      std::min(HistogramP99Us(histogram_, figures.samples), figures.update.max_us);
  figures.total_missed_ticks = last_.missed_ticks;
  figures.total_missed_percent = Percent(last_.missed_ticks, last_.tick);

  const Tick& oldest = recent_ticks_.front();
  const std::int64_t recent_span_ns = last_.time_ns - oldest.time_ns;
  figures.recent_ticks_per_s = PerSecond(last_.tick - oldest.tick, recent_span_ns);
  figures.recent_missed_per_s = PerSecond(last_.missed_ticks - oldest.missed_ticks, recent_span_ns);
  std::vector<std::int64_t> update_ns;
  update_ns.reserve(recent_ticks_.size());
  for (const Tick& tick : recent_ticks_) {
    update_ns.push_back(tick.update_ns);
  }
  figures.recent_update = Summarise(std::move(update_ns));

  // The first message of the window only marks the start of the count. If the stream stands still,
  // its old rate must not stay on the display.
  std::uint64_t arrived = 0;
  for (std::size_t i = 1; i < recent_arrivals_.size(); ++i) {
    arrived += recent_arrivals_[i].samples;
  }
  const Arrival& newest = recent_arrivals_.back();
  const bool stands_still = now_ns - newest.now_ns > kWindowNs;
  figures.recent_samples_per_s =
      stands_still ? 0.0 : PerSecond(arrived, newest.now_ns - recent_arrivals_.front().now_ns);
  const std::int64_t offset_ns = shares_clock_ ? 0 : least_delay_ns_;
  figures.age_ms = static_cast<double>(now_ns - last_.time_ns - offset_ns) * 1e-6;
  return figures;
}

}  // namespace palpate::cli
