#include "server/device/usb/usb_device.h"

#include <pthread.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "common/error/error.h"
#include "server/device/usb/device_log.h"
#include "server/realtime/latest_value.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr microseconds kLongestWait{1000};
// Readings come about every ms. If none comes for this long, a frame is sent anyway.
constexpr std::int64_t kMissingReadingNs = kNsPerMs * 3 / 2;
// After this time, a question without an answer is asked again.
constexpr std::int64_t kAskAgainNs = 10 * kNsPerMs;
constexpr std::int64_t kCorruptReportNs = 1000 * kNsPerMs;
constexpr milliseconds kLastForceTime{50};

// Eigen does not declare that copying a few numbers throws nothing.
struct TimedReading {
  TimedReading& operator=(const TimedReading&) noexcept = default;
  DeviceState state{};
  std::int64_t time_ns = 0;
};

struct TimedForce {
  TimedForce& operator=(const TimedForce&) noexcept = default;
  Vec3 force_D_n = Vec3::Zero();
  bool motors_on = false;
  std::int64_t time_ns = 0;  // 0: the servo has not started
};

// Written by the I/O thread, read by any thread.
struct Counters {
  std::atomic<bool> docked{false};
  std::atomic<bool> calibrated{false};
  std::atomic<std::uint64_t> readings{0};
  std::atomic<std::uint64_t> forces_written{0};
  std::atomic<std::uint64_t> lost_readings{0};
  std::atomic<std::uint64_t> corrupt_frames{0};
  std::atomic<std::uint64_t> transfer_errors{0};
  std::atomic<std::uint64_t> connections{0};
  std::atomic<std::uint64_t> watchdog_zeros{0};
};

}  // namespace

struct UsbDevice::Impl {
  Impl(std::unique_ptr<UsbProtocol> its_protocol, int its_priority)
      : protocol(std::move(its_protocol)), priority(its_priority), log(protocol->spec().kind) {}

  void Run();
  void SetUpThread();
  void Connect();
  void Stream(UsbLink& link, const std::string& identity);
  void TakeBytes(UsbLink& link, std::span<const std::uint8_t> bytes);
  void BeginStreaming(const UsbLink& link, const std::string& identity);
  bool IsForceDue(std::int64_t now_ns) const;
  void SendForce(UsbLink& link, std::int64_t now_ns);
  void ReportCorruptFrames(std::int64_t now_ns);
  std::span<const std::uint8_t> SafeFrame() noexcept;
  void LetGo(UsbLink& link, bool had_stream) noexcept;
  void Explain(const UsbError& error, bool was_open);
  void WaitToRetry();

  const std::unique_ptr<UsbProtocol> protocol;
  const int priority;

  // Exchanged between the servo and the I/O thread.
  LatestValue<TimedReading> readings;
  LatestValue<TimedForce> forces;
  std::atomic<DeviceConnection> connection{DeviceConnection::kAbsent};
  std::atomic<bool> watchdog_holds{false};

  bool motors_on = false;  // the servo thread's

  // For all other threads. While the device streams, the I/O thread only counts. The caller of
  // NextEvent makes log lines from the counts.
  DeviceLog log;
  Counters counters;
  std::mutex report_mutex;  // guards the next two
  std::uint64_t corrupt_frames_told = 0;
  std::int64_t corrupt_report_ns = 0;

  std::thread thread;
  std::mutex stop_mutex;
  std::condition_variable stopped;
  std::atomic<bool> stop{false};

  // Used by the I/O thread only.
  TimedReading reading;
  bool has_reading = false;    // in this connection
  bool is_unsuitable = false;  // the device that was found cannot be used
  bool wants_to_send = false;  // the last frame was still under way
  std::int64_t last_reading_ns = 0;
  std::int64_t last_send_ns = 0;
  std::uint64_t transfer_errors = 0;  // of earlier connections
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> frame{};
};

void UsbDevice::Impl::Run() {
  SetUpThread();
  while (!stop) {
    is_unsuitable = false;
    Connect();
    connection = DeviceConnection::kAbsent;
    counters.docked = false;
    counters.calibrated = false;
    WaitToRetry();
  }
}

void UsbDevice::Impl::SetUpThread() {
  if (priority > 0) {
    RealtimeGrant grant;
    SetupRealtimeThread({.priority = priority, .cpu = -1, .lock_memory = false}, grant);
    for (const std::string& warning : grant.warnings) {
      log.Add(DeviceEvent::Level::kWarning, warning);
    }
  }
  pthread_setname_np(pthread_self(), "palpate-usb");
}

// Looks for the device, sets it up, streams, and releases it.
void UsbDevice::Impl::Connect() {
  bool was_open = false;
  try {
    UsbLink link(protocol->match());
    was_open = true;
    bool has_stream = false;
    connection = DeviceConnection::kConnecting;
    try {
      const std::string identity = protocol->SetUp(link, stop);
      link.StartStream(
          UsbProtocol::kMaxFrameBytes,
          [&](std::span<const std::uint8_t> bytes) { TakeBytes(link, bytes); }, SafeFrame());
      has_stream = true;
      Stream(link, identity);
      LetGo(link, has_stream);
    } catch (...) {
      LetGo(link, has_stream);
      throw;
    }
  } catch (const UsbError& error) {
    if (!stop) Explain(error, was_open);
  } catch (const std::exception& error) {
    log.SetProblem(error.what());
  }
}

void UsbDevice::Impl::Stream(UsbLink& link, const std::string& identity) {
  has_reading = false;
  wants_to_send = false;
  reading = {};
  last_send_ns = 0;  // asks a request-response device at once
  last_reading_ns = MonotonicNowNs();
  while (!stop) {
    link.Wait(kLongestWait);
    const std::int64_t now_ns = MonotonicNowNs();
    // Runs once, because it takes a lock and makes strings. Forces are off before it.
    if (has_reading && connection != DeviceConnection::kStreaming) {
      BeginStreaming(link, identity);
    }
    if (IsForceDue(now_ns)) SendForce(link, now_ns);
    counters.transfer_errors = transfer_errors + link.transfer_errors();
    if (now_ns - last_reading_ns > kSilentMs * kNsPerMs) {
      throw UsbError(UsbFault::kTimeout, "no reading for " + std::to_string(kSilentMs) + " ms");
    }
  }
}

// Called during Wait. Answers every reading at once with the newest force.
void UsbDevice::Impl::TakeBytes(UsbLink& link, std::span<const std::uint8_t> bytes) {
  const UsbReceived received = protocol->Receive(bytes, reading.state);
  counters.readings += received.readings;
  counters.lost_readings += received.lost_readings;
  counters.corrupt_frames += received.corrupt_frames;
  if (!received.has_reading) return;
  reading.time_ns = MonotonicNowNs();
  last_reading_ns = reading.time_ns;
  has_reading = true;
  counters.docked = reading.state.docked;
  counters.calibrated = reading.state.calibrated;
  readings.Write(reading);
  SendForce(link, reading.time_ns);
}

void UsbDevice::Impl::BeginStreaming(const UsbLink& link, const std::string& identity) {
  ++counters.connections;
  log.SetConnected(link.found().port, identity);
  connection = DeviceConnection::kStreaming;
}

bool UsbDevice::Impl::IsForceDue(std::int64_t now_ns) const {
  if (wants_to_send) return true;
  if (protocol->is_request_response()) return now_ns - last_send_ns > kAskAgainNs;
  return now_ns - std::max(last_send_ns, last_reading_ns) > kMissingReadingNs;
}

void UsbDevice::Impl::SendForce(UsbLink& link, std::int64_t now_ns) {
  const TimedForce& newest = forces.Read();
  const bool servo_is_alive = newest.time_ns != 0 &&
                              now_ns - newest.time_ns <= kServoSilentMs * kNsPerMs &&
                              newest.force_D_n.allFinite();
  if (newest.time_ns != 0 && !servo_is_alive) {
    watchdog_holds = true;
  } else if (newest.force_D_n.isZero()) {
    watchdog_holds = false;
  }
  const bool may_push = servo_is_alive && !watchdog_holds && newest.motors_on;
  const Vec3 force_D_n = may_push ? newest.force_D_n : Vec3::Zero();
  const std::size_t size = protocol->Encode(force_D_n, may_push, frame);
  wants_to_send = !link.TrySend({frame.data(), size});
  if (wants_to_send) return;
  last_send_ns = now_ns;
  ++counters.forces_written;
  if (!servo_is_alive && newest.time_ns != 0) ++counters.watchdog_zeros;
}

void UsbDevice::Impl::ReportCorruptFrames(std::int64_t now_ns) {
  const std::lock_guard lock(report_mutex);
  const std::uint64_t all = counters.corrupt_frames, untold = all - corrupt_frames_told;
  if (untold == 0 || now_ns - corrupt_report_ns < kCorruptReportNs) return;
  log.Add(DeviceEvent::Level::kWarning,
          std::to_string(untold) + " corrupt frame" + (untold == 1 ? "" : "s") + " dropped");
  corrupt_frames_told = all;
  corrupt_report_ns = now_ns;
}

// The frame with zero force and motors off.
std::span<const std::uint8_t> UsbDevice::Impl::SafeFrame() noexcept {
  return {frame.data(), protocol->Encode(Vec3::Zero(), false, frame)};
}

// Attempted even if the device seems to be gone: motors that keep their last force are worse than a
// failed transfer.
void UsbDevice::Impl::LetGo(UsbLink& link, bool had_stream) noexcept {
  connection = DeviceConnection::kConnecting;
  try {
    link.EndStream();
    if (had_stream) {
      link.Send(SafeFrame(), kLastForceTime);
      ++counters.forces_written;
    }
  } catch (const UsbError&) {
    // Nobody is left to get the error.
  }
  protocol->TearDown(link);
  transfer_errors += link.transfer_errors();
  counters.transfer_errors = transfer_errors;
}

void UsbDevice::Impl::Explain(const UsbError& error, bool was_open) {
  is_unsuitable = error.fault() == UsbFault::kUnsuitable;
  static const std::string kUnplugged = "unplugged; looking for it again";
  if (!was_open) {
    DeviceHealth known;
    log.FillIn(known);
    // After an unplugging, "not found" is no news.
    if (error.fault() == UsbFault::kAbsent && known.problem == kUnplugged) return;
    log.SetProblem(error.what());
  } else if (error.fault() == UsbFault::kAbsent) {
    log.SetProblem(kUnplugged);
  } else if (error.fault() == UsbFault::kUnsuitable) {
    log.SetProblem(error.what());
  } else {
    log.SetProblem(std::string(error.what()) + "; connecting again");
  }
}

void UsbDevice::Impl::WaitToRetry() {
  std::unique_lock lock(stop_mutex);
  const milliseconds time(is_unsuitable ? kUnsuitableRetryMs : kRetryMs);
  stopped.wait_for(lock, time, [this] { return stop.load(); });
}

UsbDevice::UsbDevice(std::unique_ptr<UsbProtocol> protocol, int realtime_priority)
    : impl_(std::make_unique<Impl>(std::move(protocol), realtime_priority)) {}

UsbDevice::~UsbDevice() { Stop(); }

const DeviceDescription& UsbDevice::spec() const { return impl_->protocol->spec(); }

void UsbDevice::Start() {
  if (impl_->thread.joinable()) return;
  impl_->stop = false;
  impl_->thread = std::thread([this] { impl_->Run(); });
}

void UsbDevice::Stop() noexcept {
  if (!impl_->thread.joinable()) return;
  {
    const std::lock_guard lock(impl_->stop_mutex);
    impl_->stop = true;
  }
  impl_->stopped.notify_all();
  impl_->thread.join();
}

DeviceStatus UsbDevice::Read(DeviceState& state) noexcept {
  if (impl_->connection != DeviceConnection::kStreaming) return DeviceStatus::kFault;
  const TimedReading& newest = impl_->readings.Read();
  state = newest.state;
  const std::int64_t age_ns = MonotonicNowNs() - newest.time_ns;
  if (age_ns > kSilentMs * kNsPerMs) return DeviceStatus::kFault;
  const bool is_stale = age_ns > kStaleAfterMs * kNsPerMs || impl_->watchdog_holds;
  return is_stale ? DeviceStatus::kStale : DeviceStatus::kOk;
}

void UsbDevice::Write(const Vec3& force_D_n, double /*dt_s*/) noexcept {
  impl_->forces.Write(
      {.force_D_n = force_D_n, .motors_on = impl_->motors_on, .time_ns = MonotonicNowNs()});
}

void UsbDevice::SetMotors(bool on) noexcept { impl_->motors_on = on; }

DeviceHealth UsbDevice::health() const {
  const Counters& counters = impl_->counters;
  DeviceHealth health;
  health.connection = impl_->connection;
  health.docked = counters.docked;
  health.calibrated = counters.calibrated;
  health.readings = counters.readings;
  health.forces_written = counters.forces_written;
  health.lost_readings = counters.lost_readings;
  health.corrupt_frames = counters.corrupt_frames;
  health.transfer_errors = counters.transfer_errors;
  health.connections = counters.connections;
  health.watchdog_zeros = counters.watchdog_zeros;
  impl_->log.FillIn(health);
  const bool is_lost = health.connection == DeviceConnection::kStreaming && !health.calibrated;
  if (health.problem.empty() && is_lost) health.problem = impl_->protocol->calibration_hint();
  return health;
}

std::optional<DeviceEvent> UsbDevice::NextEvent() {
  impl_->ReportCorruptFrames(MonotonicNowNs());
  return impl_->log.Next();
}

void UsbDevice::Calibrate() {
  if (!impl_->protocol->RequestCalibration()) HapticDevice::Calibrate();
}

}  // namespace palpate
