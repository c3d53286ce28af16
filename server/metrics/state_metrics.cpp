#include "server/metrics/state_metrics.h"

#include <prometheus/metric_family.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "common/contract/enumerations.h"

namespace palpate {
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
