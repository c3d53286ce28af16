#include "server/metrics/state_metrics.h"

#include <prometheus/metric_family.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "common/contract/enumerations.h"
#include "server/metrics/exporter.h"

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

namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Families = std::vector<MetricFamily>;

template <class Number>
void Add(Families& families, MetricType type, const char* name, const char* help, Number number) {
  ClientMetric metric;
  metric.counter.value = metric.gauge.value = static_cast<double>(number);
  families.push_back({name, help, type, {metric}});
}

template <class Number>
void Gauge(Families& families, const char* name, const char* help, Number number) {
  Add(families, MetricType::Gauge, name, help, number);
}

template <class Number>
void Counter(Families& families, const char* name, const char* help, Number number) {
  Add(families, MetricType::Counter, name, help, number);
}

std::uint64_t ResidentBytes() {
  std::uint64_t total_pages = 0;
  std::uint64_t resident_pages = 0;
  std::ifstream("/proc/self/statm") >> total_pages >> resident_pages;
  return resident_pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::size_t OpenFiles() {
  std::error_code error;
  std::size_t count = 0;
  for (std::filesystem::directory_iterator file("/proc/self/fd", error), end; file != end;
       file.increment(error)) {
    ++count;
  }
  return count;
}

void AddProcess(Families& families, const MeasuredParts& parts) {
  Gauge(families, "palpate_resident_memory_bytes", "Memory of the daemon that is in RAM",
        ResidentBytes());
  Gauge(families, "palpate_open_files", "Open file descriptors of the daemon", OpenFiles());
  Gauge(families, "palpate_volume_memory_bytes",
        "Memory held by volumes, with what undo, series and streams hold, and uploads, as the "
        "budget counts it",
        parts.budget.held_bytes());
  Gauge(families, "palpate_volume_memory_budget_bytes",
        "Upper limit of palpate_volume_memory_bytes", parts.budget_bytes);
}

void AddServo(Families& families, const ServoLoop& servo) {
  Counter(families, "palpate_lost_samples_total",
          "Samples of the servo that the pump did not take in time", servo.lost_samples());
  Counter(families, "palpate_page_faults_total", "Page faults of the servo thread",
          servo.page_faults());
  Gauge(families, "palpate_realtime_scheduling", "1: the servo thread runs with SCHED_FIFO",
        servo.grant().fifo);
  Gauge(families, "palpate_memory_locked", "1: the daemon's memory is locked",
        servo.grant().memory_locked);
}

// One series per state, with the value 1 for the present state: dashboards and alerts use the
// state's name.
void AddForces(Families& families, const ForceWatch& watch) {
  MetricFamily family{"palpate_forces", "1: forces are in this state", MetricType::Gauge, {}};
  const std::optional<ForceTick> newest = watch.newest();
  for (const std::string_view state : kWords<ForceState>) {
    ClientMetric metric;
    metric.label.push_back({"state", std::string(state)});
    metric.gauge.value = newest && NameOf(newest->forces.state) == state;
    family.metric.push_back(std::move(metric));
  }
  families.push_back(std::move(family));
}

void AddRecording(Families& families, const RecordingStatus& status) {
  Gauge(families, "palpate_recording", "1: a recording runs", status.running);
  Gauge(families, "palpate_recording_failed", "1: the last recording ended early, by an error",
        status.error.has_value());
}

void AddDevice(Families& families, const DeviceHealth& health) {
  Gauge(families, "palpate_device_connected", "1: the device sends readings",
        health.connection == DeviceConnection::kStreaming);
  Counter(families, "palpate_device_connections_total",
          "Times that the device was connected; of hardware", health.connections);
  Counter(families, "palpate_device_lost_readings_total", "Readings whose numbers are missing",
          health.lost_readings);
  Counter(families, "palpate_device_corrupt_frames_total", "Frames of the device that were dropped",
          health.corrupt_frames);
  Counter(families, "palpate_device_transfer_errors_total", "Transfers that failed",
          health.transfer_errors);
  Counter(families, "palpate_device_watchdog_zeros_total",
          "Zero forces written because the servo did not tick", health.watchdog_zeros);
}

}  // namespace

Families StateMetrics::Collect() const {
  Families families;
  AddProcess(families, parts_);
  AddServo(families, parts_.servo);
  AddForces(families, parts_.forces);
  AddRecording(families, parts_.recording.status());
  AddDevice(families, parts_.device.health());
  Gauge(families, "palpate_volume_streams", "Subscribers of the volume", parts_.volume_streams());
  return families;
}

}  // namespace palpate
