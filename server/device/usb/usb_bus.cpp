#include "server/device/usb/usb_bus.h"

#include <array>
#include <span>
#include <utility>

#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

constexpr std::chrono::milliseconds kLastForceTime{50};

class UsbSession final : public StreamSession {
 public:
  explicit UsbSession(UsbProtocol& protocol) : protocol_(protocol), link_(protocol.match()) {}

  std::string place() const override { return "USB port " + link_.found().port; }
  std::string identity() const override { return identity_; }
  std::uint64_t transfer_errors() const override { return link_.transfer_errors(); }

  void SetUp(const std::atomic<bool>& stop) override {
    identity_ = protocol_.SetUp(link_, stop);
    link_.StartStream(
        UsbProtocol::kMaxFrameBytes,
        [this](std::span<const std::uint8_t> bytes) { Take(protocol_.Receive(bytes, *state_)); },
        FrameOf({}));
    streams_ = true;
  }

  StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) override {
    received_ = {};
    state_ = &state;
    link_.Wait(longest);
    received_.restarted = std::exchange(mends_, link_.mends()) != link_.mends();
    return received_;
  }

  bool TrySend(const DeviceCommand& command) override { return link_.TrySend(FrameOf(command)); }

  bool LetGo() noexcept override {
    bool sent = false;
    try {
      link_.EndStream();
      if (streams_) SendLast();
      sent = streams_;
    } catch (const BusError&) {
      // Nobody is left to get the error.
    }
    protocol_.TearDown(link_);
    return sent;
  }

 private:
  // A stalled endpoint is cleared by the first try.
  void SendLast() {
    try {
      link_.Send(FrameOf({}), kLastForceTime);
    } catch (const BusError& error) {
      if (error.fault() != BusFault::kStall) throw;
      link_.Send(FrameOf({}), kLastForceTime);
    }
  }
  void Take(const StreamReceived& more) {
    received_.has_reading |= more.has_reading;
    if (more.has_reading) received_.time_ns = MonotonicNowNs();
    received_.readings += more.readings;
    received_.lost_readings += more.lost_readings;
    received_.corrupt_frames += more.corrupt_frames;
  }
  std::span<const std::uint8_t> FrameOf(const DeviceCommand& command) noexcept {
    return {frame_.data(), protocol_.Encode(command, frame_)};
  }

  UsbProtocol& protocol_;
  UsbLink link_;
  std::string identity_;
  bool streams_ = false;
  std::uint64_t mends_ = 0;
  StreamReceived received_;  // in this Wait
  DeviceState* state_ = nullptr;
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> frame_{};
};

}  // namespace

std::unique_ptr<StreamSession> UsbBus::Open(const std::atomic<bool>& /*stop*/) {
  return std::make_unique<UsbSession>(*protocol_);
}

}  // namespace palpate
