#include "server/device/stream/device_seat.h"

#include <utility>

#include "server/realtime/tick_timer.h"

namespace palpate {

DeviceLog::DeviceLog(std::string name) : name_(std::move(name)) {}

void DeviceLog::SetProblem(const std::string& problem, DeviceEvent::Level level) {
  const std::lock_guard lock(mutex_);
  if (problem == problem_) return;
  problem_ = problem;
  if (!problem.empty()) Push(level, name_ + ": " + problem);
}

void DeviceLog::SetConnected(const std::string& place, const std::string& identity) {
  const std::lock_guard lock(mutex_);
  problem_.clear();
  identity_ = identity;
  Push(DeviceEvent::Level::kInfo, name_ + (place.empty() ? "" : " on " + place) + ": connected" +
                                      (identity.empty() ? "" : ", " + identity));
}

void DeviceLog::Add(DeviceEvent::Level level, const std::string& text) {
  const std::lock_guard lock(mutex_);
  Push(level, name_ + ": " + text);
}

std::optional<DeviceEvent> DeviceLog::Next() {
  const std::lock_guard lock(mutex_);
  if (events_.empty()) return std::nullopt;
  DeviceEvent event = std::move(events_.front());
  events_.pop_front();
  return event;
}

void DeviceLog::FillIn(DeviceHealth& health) const {
  const std::lock_guard lock(mutex_);
  health.identity = identity_;
  health.problem = problem_;
}

void DeviceLog::Push(DeviceEvent::Level level, std::string text) {
  if (events_.size() == kMaxEvents) events_.pop_front();
  events_.push_back({.level = level, .text = std::move(text)});
}

namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kCorruptReportNs = 1000 * kNsPerMs;

}  // namespace

DeviceStatus DeviceSeat::Read(DeviceState& state) noexcept {
  if (!is_streaming()) return DeviceStatus::kFault;
  const Reading& newest = readings_.Read();
  state = newest.state;
  const std::int64_t age_ns = MonotonicNowNs() - newest.time_ns;
  if (age_ns > kSilentMs * kNsPerMs) return DeviceStatus::kFault;
  const bool is_stale = age_ns > kStaleAfterMs * kNsPerMs || watchdog_holds_;
  return is_stale ? DeviceStatus::kStale : DeviceStatus::kOk;
}

void DeviceSeat::Write(const DeviceCommand& command) noexcept {
  commands_.Write({.command = command, .time_ns = MonotonicNowNs()});
}

void DeviceSeat::Take(const DeviceState& state, std::int64_t time_ns) noexcept {
  docked_ = state.docked;
  calibrated_ = state.calibrated;
  readings_.Write({.state = state, .time_ns = time_ns});
}

DeviceCommand DeviceSeat::Next() noexcept {
  const Command& newest = commands_.Read();
  servo_is_silent_ =
      newest.time_ns != 0 && MonotonicNowNs() - newest.time_ns > kServoSilentMs * kNsPerMs;
  if (newest.time_ns == 0) return {};
  if (servo_is_silent_ || !newest.command.wrench_M.allFinite()) {
    watchdog_holds_ = true;
  } else if (newest.command.wrench_M.is_zero()) {
    watchdog_holds_ = false;
  }
  const bool may_push = !watchdog_holds_ && newest.command.motors_on;
  return may_push ? newest.command : DeviceCommand();
}

void DeviceSeat::CountSent() noexcept {
  ++counts.forces_written;
  if (servo_is_silent_) ++counts.watchdog_zeros;
}

void DeviceSeat::BeStreaming(const std::string& place, const std::string& identity) {
  ++counts.connections;
  log_.SetConnected(place, identity);
  SetConnection(DeviceConnection::kStreaming);
}

void DeviceSeat::SetConnection(DeviceConnection connection) noexcept {
  if (connection == DeviceConnection::kAbsent) docked_ = calibrated_ = false;
  connection_ = connection;
}

DeviceHealth DeviceSeat::health(const std::string& hint) const {
  DeviceHealth health{.connection = connection_,
                      .docked = docked_,
                      .calibrated = calibrated_,
                      .readings = counts.readings,
                      .forces_written = counts.forces_written,
                      .lost_readings = counts.lost_readings,
                      .corrupt_frames = counts.corrupt_frames,
                      .transfer_errors = counts.transfer_errors,
                      .connections = counts.connections,
                      .watchdog_zeros = counts.watchdog_zeros};
  log_.FillIn(health);
  const bool is_lost = health.connection == DeviceConnection::kStreaming && !health.calibrated;
  if (health.problem.empty() && is_lost) health.problem = hint;
  return health;
}

std::optional<DeviceEvent> DeviceSeat::NextEvent() {
  ReportCorruptFrames();
  return log_.Next();
}

void DeviceSeat::ReportCorruptFrames() {
  const std::int64_t now_ns = MonotonicNowNs();
  const std::lock_guard lock(report_mutex_);
  const std::uint64_t all = counts.corrupt_frames, untold = all - corrupt_frames_told_;
  if (untold == 0 || now_ns - corrupt_report_ns_ < kCorruptReportNs) return;
  log_.Add(DeviceEvent::Level::kWarning,
           std::to_string(untold) + " corrupt frame" + (untold == 1 ? "" : "s") + " dropped");
  corrupt_frames_told_ = all;
  corrupt_report_ns_ = now_ns;
}

}  // namespace palpate
