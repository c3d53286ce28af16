#include "tests/load/servo_figures.h"

#include <algorithm>
#include <cmath>

namespace palpate::load {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;
constexpr std::int64_t kBinNs = 1'000;
// A grid seen a little before its fullest bin is no tick that is a period late.
constexpr std::int64_t kBeforeNs = 100'000;
// Below this share of the ticks, it is such late ticks that are seen.
constexpr double kEarliest = 0.02;

std::int64_t After(std::int64_t time_ns, std::int64_t phase_ns) {
  const std::int64_t late_ns = (time_ns - phase_ns) % kPeriodNs;
  return late_ns < 0 ? late_ns + kPeriodNs : late_ns;
}

}  // namespace

double Percentile(std::vector<double> values, double p) {
  if (values.empty()) return 0.0;
  const auto last = static_cast<double>(values.size() - 1);
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(std::llround(p * last));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

std::int64_t GridPhaseNs(std::span<const Received> ticks) {
  std::vector<std::size_t> bins(kPeriodNs / kBinNs);
  for (const Received& tick : ticks)
    ++bins[static_cast<std::size_t>(After(tick.time_ns, 0) / kBinNs)];
  const auto fullest = std::max_element(bins.begin(), bins.end()) - bins.begin();
  const std::int64_t begin_ns = fullest * kBinNs - kBeforeNs;
  std::vector<double> after_ns;
  for (const Received& tick : ticks) {
    after_ns.push_back(static_cast<double>(After(tick.time_ns, begin_ns)));
  }
  return begin_ns + std::llround(Percentile(std::move(after_ns), kEarliest));
}

ServoFigures FiguresOf(std::span<const Received> ticks, std::int64_t phase_ns, std::int64_t from_ns,
                       std::int64_t to_ns) {
  ServoFigures figures;
  std::vector<double> wake_up_us, update_us;
  const Received* first = nullptr;
  const Received* last = nullptr;
  for (const Received& tick : ticks) {
    if (tick.time_ns < from_ns || tick.time_ns >= to_ns) continue;
    if (first == nullptr) first = &tick;
    last = &tick;
    // The few that seem to be before the grid are on it.
    const std::int64_t late_ns = After(tick.time_ns, phase_ns - kBinNs) - kBinNs;
    wake_up_us.push_back(static_cast<double>(std::max<std::int64_t>(late_ns, 0)) * 1e-3);
    update_us.push_back(static_cast<double>(tick.update_ns) * 1e-3);
    figures.contact_faults += tick.is_contact_fault;
  }
  figures.ticks = update_us.size();
  if (first == nullptr || last == first) return figures;
  figures.missed_share = static_cast<double>(last->missed_ticks - first->missed_ticks) /
                         static_cast<double>(last->loop_ms - first->loop_ms);
  figures.wake_up_p99_us = Percentile(std::move(wake_up_us), 0.99);
  figures.update_p99_us = Percentile(std::move(update_us), 0.99);
  return figures;
}

}  // namespace palpate::load
