#include "server/metrics/servo_metrics.h"

#include <cmath>

#include "server/metrics/families.h"

namespace palpate {
namespace {

constexpr double kSPerNs = 1e-9;
// Allows for rounding of a clamped force.
constexpr double kAtLimit = 1.0 - 1e-9;

// Narrow buckets around 1 ms: they show how exactly the servo wakes up.
const std::vector<double> kPeriodBounds_s = {
    0.0005,   0.0008, 0.0009,   0.00095,  0.00098, 0.00099, 0.000995,
    0.000998, 0.001,  0.001002, 0.001005, 0.00101, 0.00102, 0.00105,
    0.0011,   0.0012, 0.0015,   0.002,    0.005,   0.02,    0.1};
const std::vector<double> kUpdateBounds_s = {1e-6, 2e-6, 3e-6, 5e-6, 7e-6, 1e-5, 1.5e-5, 2e-5,
                                             3e-5, 5e-5, 7e-5, 1e-4, 2e-4, 5e-4, 1e-3,   5e-3};
const std::vector<double> kForceBounds_n = {0.0, 0.1, 0.25, 0.5, 0.75, 1.0,
                                            1.5, 2.0, 2.5,  3.0, 3.3};

double Length(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

// True if the proxy is held on the surface and yet inside the material. This must never happen.
bool IsContactFault(const TickSample& sample) {
  if (sample.mode != ProxyMode::kFree && sample.mode != ProxyMode::kConstrained) return false;
  return sample.free_side == FreeSide::kBelow ? sample.density > sample.isovalue
                                              : sample.density < sample.isovalue;
}

// By how much a running total has grown since the last sample. Totals also include samples that
// were lost.
double Growth(std::uint64_t now, std::uint64_t& before) {
  const std::uint64_t growth = now - before;
  before = now;
  return static_cast<double>(growth);
}

}  // namespace

ServoMetrics::ServoMetrics(prometheus::Registry& registry)
    : period_(AddHistogram(registry, "palpate_tick_period_seconds",
                           "Time from the start of one tick to that of the next", kPeriodBounds_s)),
      update_(AddHistogram(registry, "palpate_update_seconds",
                           "Duration of a tick's haptic update, without device and sleep",
                           kUpdateBounds_s)),
      force_(AddHistogram(registry, "palpate_force_newtons",
                          "Magnitude of the force on the hand after every limit, per tick",
                          kForceBounds_n)),
      ticks_(AddCounter(registry, "palpate_ticks_total", "Ticks that the metrics have counted")),
      missed_(AddCounter(registry, "palpate_missed_ticks_total",
                         "Ticks that were skipped because their time had passed")),
      contact_(AddCounter(registry, "palpate_contact_ticks_total",
                          "Ticks in which the proxy lay on the surface")),
      contact_faults_(AddCounter(registry, "palpate_contact_faults_total",
                                 "Ticks in which the proxy was held inside the material")),
      faulty_(AddCounter(registry, "palpate_faulty_ticks_total",
                         "Ticks with zero force because of the device, a bad position or force")),
      capped_(AddCounter(registry, "palpate_capped_ticks_total",
                         "Ticks in which the proxy reached the limit of its moves")),
      saturated_(AddCounter(registry, "palpate_saturated_ticks_total",
                            "Ticks with a force at the force limit")),
      force_limit_(AddGauge(registry, "palpate_force_limit_newtons",
                            "Force limit now, after the limit for warm motors")),
      settings_revision_(AddGauge(registry, "palpate_settings_revision",
                                  "Revision of the settings in use by the servo")),
      volume_revision_(AddGauge(registry, "palpate_volume_revision",
                                "Revision of the volume in use by the servo")) {}

void ServoMetrics::OnSample(const TickSample& sample) {
  // The period is known only if no sample was lost in between.
  if (tick_ != 0 && sample.tick == tick_ + 1)
    period_.Observe(static_cast<double>(sample.time_ns - time_ns_) * kSPerNs);
  time_ns_ = sample.time_ns;
  tick_ = sample.tick;
  update_.Observe(static_cast<double>(sample.update_ns) * kSPerNs);
  CountTick(sample);
  force_limit_.Set(sample.force_limit_n);
  settings_revision_.Set(static_cast<double>(sample.settings_revision));
  volume_revision_.Set(static_cast<double>(sample.volume_revision));
}

void ServoMetrics::CountTick(const TickSample& sample) {
  const double force_n = Length(sample.force_n);
  force_.Observe(force_n);
  ticks_.Increment();
  missed_.Increment(Growth(sample.missed_ticks, missed_ticks_));
  faulty_.Increment(Growth(sample.faulty_ticks, faulty_ticks_));
  capped_.Increment(Growth(sample.capped_ticks, capped_ticks_));
  if (sample.contact) contact_.Increment();
  if (IsContactFault(sample)) contact_faults_.Increment();
  if (force_n > 0.0 && force_n >= sample.force_limit_n * kAtLimit) saturated_.Increment();
}

}  // namespace palpate
