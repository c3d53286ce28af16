// A kind of device on USB, for StreamedDevice: finds it, and streams what its protocol says.
//
// Threads, errors: as StreamBus.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/stream/streamed_device.h"
#include "server/device/usb/usb_link.h"

namespace palpate {

// The protocol of one kind of USB device: what the bytes mean. StreamedDevice and UsbBus do the
// rest: thread, exchange, watchdog and transfer.
//
// Threads: the I/O thread; spec and match on any thread. Real-time: Receive and Encode do not
// allocate, lock or throw.
class UsbProtocol {
 public:
  static constexpr std::size_t kMaxFrameBytes = 512;

  virtual ~UsbProtocol() = default;

  virtual const DeviceDescription& spec() const = 0;
  virtual const UsbMatch& match() const = 0;

  // Brings an opened device to the state in which it streams, and forgets the previous connection.
  // Waits for answers, for seconds at most; gives up soon after `stop` becomes true. Returns the
  // device's identity, for people. Throws BusError.
  virtual std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) = 0;

  // Takes the bytes of one IN transfer. They may hold parts of frames; an unfinished frame is kept.
  // Sets `state` if there is a reading.
  virtual StreamReceived Receive(std::span<const std::uint8_t> bytes,
                                 DeviceState& state) noexcept = 0;

  // Writes the frame that does this at the last position of the stylus, and returns its length in
  // bytes. If the motors are to be off, the frame switches them off, whatever the force.
  virtual std::size_t Encode(const DeviceCommand& command,
                             std::span<std::uint8_t, kMaxFrameBytes> out) noexcept = 0;

  // True: the device answers each force with one reading. False: the device streams by itself, and
  // a frame is also written if no reading came for a period.
  virtual bool is_request_response() const = 0;

  // Stops the device. Called after the last zero force and before the interface is released. Errors
  // are ignored.
  virtual void TearDown(UsbLink& link) noexcept = 0;

  // What a person must do before the first calibrated reading, one line. Any thread.
  virtual const char* calibration_hint() const noexcept = 0;

  // Makes the next docked reading the place of rest. Returns false if the device has none. Any
  // thread.
  virtual bool RequestCalibration() noexcept { return false; }
};

class UsbBus final : public StreamBus {
 public:
  explicit UsbBus(std::unique_ptr<UsbProtocol> protocol) : protocol_(std::move(protocol)) {}

  const DeviceDescription& spec() const override { return protocol_->spec(); }
  std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) override;
  bool is_request_response() const override { return protocol_->is_request_response(); }
  std::string calibration_hint() const override { return protocol_->calibration_hint(); }
  void RequestCalibration() override {
    if (!protocol_->RequestCalibration()) StreamBus::RequestCalibration();
  }

 private:
  const std::unique_ptr<UsbProtocol> protocol_;
};

}  // namespace palpate
