// What one kind of USB device says and understands, apart from how its bytes travel
// and when: the seam between UsbDevice (thread, exchange, watchdog) and the devices.
//
// Threads: the I/O thread; spec and match anywhere. Real-time: Receive and Encode do
// not allocate, lock or throw.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/usb/usb_link.h"

namespace palpate {

struct UsbReceived {
  bool has_reading = false;         // at least one whole, valid frame: the newest is in the state
  std::uint32_t readings = 0;       // whole, valid frames
  std::uint32_t lost_readings = 0;  // by gaps in their numbers
  std::uint32_t corrupt_frames = 0;
};

class UsbProtocol {
 public:
  static constexpr std::size_t kMaxFrameBytes = 512;

  virtual ~UsbProtocol() = default;

  virtual const DeviceSpec& spec() const = 0;
  virtual const UsbMatch& match() const = 0;

  // Brings an opened device to where it streams, forgetting all of the connection
  // before. Waits for answers, for seconds at most; gives up soon after `stop` is
  // true. Returns who the device says it is, for people. Throws UsbError.
  virtual std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) = 0;

  // Bytes of one IN transfer, which may hold parts of frames: what is left is kept.
  // `state` is set if there is a reading.
  virtual UsbReceived Receive(std::span<const std::uint8_t> bytes, DeviceState& state) noexcept = 0;

  // The frame that puts a force on the hand where the stylus was last read; returns
  // its bytes. forces_on false: the motors are off, whatever force is given.
  virtual std::size_t Encode(const Vec3& force_D_n, bool forces_on,
                             std::span<std::uint8_t, kMaxFrameBytes> out) noexcept = 0;

  // Answers one reading with one force (true), or streams of itself (false: a frame is
  // also written when no reading came for a period).
  virtual bool is_request_response() const = 0;

  // Before the interface is released, after the last zero force: what stops the
  // device. Errors are of no interest any more.
  virtual void TearDown(UsbLink& link) noexcept = 0;

  // What a person must do before the first calibrated reading, one line. Any thread.
  virtual const char* calibration_hint() const noexcept = 0;

  // The next docked reading is the place of rest. False: there is none. Any thread.
  virtual bool RequestCalibration() noexcept { return false; }
};

}  // namespace palpate
