#include "server/device/stream/streamed_device.h"

#include <algorithm>
#include <utility>

#include "server/device/stream/device_link.h"
#include "server/device/stream/device_seat.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

constexpr std::int64_t kMsNs = 1'000'000;
constexpr microseconds kLongestWait{1000};
// Readings come about every ms. If none comes for this long, a force is sent anyway.
constexpr std::int64_t kMissingReadingNs = kMsNs * 3 / 2;
// After this time, a question without an answer is asked again.
constexpr std::int64_t kAskAgainNs = 10 * kMsNs;

}  // namespace

struct StreamedDevice::Impl {
  Impl(std::unique_ptr<StreamBus> its_bus, const std::string& name, int priority)
      : bus(std::move(its_bus)), seat(bus->spec().kind), link(name, priority) {}

  milliseconds Connect();
  void Stream(StreamSession& session);
  void TellEvidence(const StreamSession& session);
  bool IsSendDue(std::int64_t now_ns) const;
  void Send(StreamSession& session, std::int64_t now_ns);
  void LetGo(StreamSession& session) noexcept;
  void Explain(const BusError& error, bool was_open);

  const std::unique_ptr<StreamBus> bus;
  DeviceSeat seat;

  // Used by the I/O thread only.
  bool wants_to_send = false;  // the last force was still under way
  bool motors_on = false;      // by the last command that was sent
  bool told_evidence = false;
  std::int64_t last_reading_ns = 0;
  std::int64_t last_send_ns = 0;
  std::uint64_t transfer_errors = 0;  // of earlier connections

  DeviceLink link;
};

// Looks for the device, sets it up, streams, and lets go of it.
milliseconds StreamedDevice::Impl::Connect() {
  bool is_open = false, is_unsuitable = false;
  try {
    const std::unique_ptr<StreamSession> session = bus->Open(link.stopping());
    is_open = true;
    seat.SetConnection(DeviceConnection::kConnecting);
    try {
      motors_on = false;
      session->SetUp(link.stopping());
      TellEvidence(*session);
      Stream(*session);
      LetGo(*session);
    } catch (...) {
      LetGo(*session);
      throw;
    }
  } catch (const BusError& error) {
    is_unsuitable = error.fault() == BusFault::kUnsuitable;
    if (!link.stopping()) Explain(error, is_open);
  } catch (const std::exception& error) {
    seat.log().SetProblem(error.what());
  } catch (...) {  // of a vendor's library
    seat.log().SetProblem("failed in an unknown way; connecting again");
  }
  seat.SetConnection(DeviceConnection::kAbsent);
  return is_unsuitable ? kUnsuitableRetry : DeviceLink::kRetry;
}

void StreamedDevice::Impl::Stream(StreamSession& session) {
  DeviceState state;
  bool is_calibrated = true;
  wants_to_send = false;
  last_send_ns = 0;  // asks a request-response device at once
  last_reading_ns = MonotonicNowNs();
  seat.Hold();
  while (!link.stopping()) {
    const StreamReceived received = session.Wait(kLongestWait, state);
    seat.counts.readings += received.readings;
    seat.counts.lost_readings += received.lost_readings;
    seat.counts.corrupt_frames += received.corrupt_frames;
    seat.counts.transfer_errors = transfer_errors + session.transfer_errors();
    const std::int64_t now_ns = MonotonicNowNs();
    if (!received.warning.empty()) {
      seat.log().Add(DeviceEvent::Level::kWarning, received.warning);
    }
    const bool lost_its_place =
        received.has_reading && std::exchange(is_calibrated, state.calibrated) && !is_calibrated;
    if (received.restarted || lost_its_place) seat.Hold();
    if (received.restarted) last_reading_ns = now_ns;
    if (received.has_reading) {
      seat.Take(state, received.time_ns);
      last_reading_ns = now_ns;
      // Runs once, because it takes a lock and makes strings. Forces are off before it.
      if (!seat.is_streaming()) seat.BeStreaming(session.place(), session.identity());
      if (lost_its_place) seat.log().Add(DeviceEvent::Level::kWarning, bus->calibration_hint());
    }
    if (received.has_reading || IsSendDue(now_ns)) Send(session, now_ns);
    if (now_ns - last_reading_ns > DeviceSeat::kSilentMs * kMsNs) {
      throw BusError(BusFault::kTimeout,
                     "no reading for " + std::to_string(DeviceSeat::kSilentMs) + " ms");
    }
  }
}

// Once: a device whose readings make no sense is set up again and again.
void StreamedDevice::Impl::TellEvidence(const StreamSession& session) {
  const std::string evidence = session.evidence();
  if (evidence.empty() || std::exchange(told_evidence, true)) return;
  seat.log().Add(DeviceEvent::Level::kInfo, evidence);
}

bool StreamedDevice::Impl::IsSendDue(std::int64_t now_ns) const {
  if (wants_to_send) return true;
  if (bus->is_request_response()) return now_ns - last_send_ns > kAskAgainNs;
  return now_ns - std::max(last_send_ns, last_reading_ns) > kMissingReadingNs;
}

void StreamedDevice::Impl::Send(StreamSession& session, std::int64_t now_ns) {
  const DeviceCommand command = seat.Next();
  wants_to_send = !session.TrySend(command);
  if (wants_to_send) return;
  motors_on = command.motors_on;
  last_send_ns = now_ns;
  seat.CountSent();
}

void StreamedDevice::Impl::LetGo(StreamSession& session) noexcept {
  seat.SetConnection(DeviceConnection::kConnecting);
  if (session.LetGo()) {
    ++seat.counts.forces_written;
  } else if (motors_on) {
    seat.log().Add(DeviceEvent::Level::kError,
                   "no zero force could be sent: while the device has power, its motors may still "
                   "push");
  }
  transfer_errors += session.transfer_errors();
  seat.counts.transfer_errors = transfer_errors;
}

void StreamedDevice::Impl::Explain(const BusError& error, bool was_open) {
  static const std::string kUnplugged = "unplugged; looking for it again";
  if (!was_open) {
    // After an unplugging, "not found" is no news.
    if (error.fault() == BusFault::kAbsent && seat.health("").problem == kUnplugged) return;
    seat.log().SetProblem(error.what());
  } else if (error.fault() == BusFault::kAbsent) {
    seat.log().SetProblem(kUnplugged);
  } else if (error.fault() == BusFault::kUnsuitable) {
    seat.log().SetProblem(error.what());
  } else {
    seat.log().SetProblem(std::string(error.what()) + "; connecting again");
  }
}

StreamedDevice::StreamedDevice(std::unique_ptr<StreamBus> bus, const std::string& thread_name,
                               int realtime_priority)
    : impl_(std::make_shared<Impl>(std::move(bus), thread_name, realtime_priority)) {}

StreamedDevice::~StreamedDevice() { Stop(); }

const DeviceDescription& StreamedDevice::spec() const { return impl_->bus->spec(); }

void StreamedDevice::Start() {
  impl_->link.Start(impl_->seat.log(), [impl = impl_] { return impl->Connect(); });
}

void StreamedDevice::Stop() noexcept {
  StopMoving();
  if (impl_->link.Stop(kLongestStop)) return;
  impl_->seat.SetConnection(DeviceConnection::kAbsent);
  impl_->seat.log().Add(DeviceEvent::Level::kError,
                        "its thread does not end, and may still hold the device: unplug the device "
                        "and plug it in again before its next use");
}

DeviceStatus StreamedDevice::Read(DeviceState& state) noexcept { return impl_->seat.Read(state); }

void StreamedDevice::Write(const DeviceCommand& command, double /*dt_s*/) noexcept {
  impl_->seat.Write(command);
}

DeviceHealth StreamedDevice::health() const {
  return impl_->seat.health(impl_->bus->calibration_hint());
}

std::optional<DeviceEvent> StreamedDevice::NextEvent() { return impl_->seat.NextEvent(); }

void StreamedDevice::StopMoving() noexcept { impl_->bus->StopMoving(); }

bool StreamedDevice::moves_by_itself() const noexcept { return impl_->bus->moves_by_itself(); }

void StreamedDevice::Calibrate() { impl_->bus->RequestCalibration(); }

void StreamBus::RequestCalibration() { RefuseCalibration(spec().kind); }

}  // namespace palpate
