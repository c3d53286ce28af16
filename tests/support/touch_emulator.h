// An emulated Touch (USB 2988:0302, CDC-ACM) for the tests.
//
// From one published trace: the framing A5 5A command length payload, the firmware
// query 0F 20 and its answer 0E 20, the serial query 0C 01 and its answer 09 61, the
// set-up frame 04 3C, and the servo's start 07 07.
// Everything else is an assumption, because the servo stream over USB is not public. The emulator
// uses what the configuration calls `framed-firewire`: the FireWire device's frames
// (server/device/omni) in that framing, with command bytes of our choice. Endpoints and
// their addresses are invented, and so is the order of its interfaces. This emulator says nothing
// about real devices.
//
// Threads: as EmulatedUsbDevice. Frame D: mm.
#pragma once

#include <atomic>
#include <functional>
#include <utility>

#include "common/geometry/geometry.h"
#include "server/device/omni/usb_frames.h"
#include "tests/support/usb_emulator.h"

namespace palpate::test {

// A force frame as the device received it.
struct TouchForce {
  std::array<int, 3> motors{};  // counts; 0: no force
  bool enabled = false;
};

class TouchEmulator final : public EmulatedUsbDevice {
 public:
  static constexpr std::uint8_t kNotify = 0x81, kDataIn = 0x82, kDataOut = 0x03;
  static constexpr std::uint8_t kControlInterface = 1;

  TouchEmulator();

  // The gimbal's place, by the seconds from now; each state takes a millisecond. A slow bus thus
  // makes the stylus slow, and never makes it leap. A place out of the arm's reach does not move
  // it. It begins with all encoders at 0, at (0, -110, -35).
  using Path = std::function<Vec3(double)>;
  void SetPath(Path path) {
    const std::scoped_lock lock(mutex());
    path_ = std::move(path);
    path_begin_ = counter_;
  }

  std::atomic<bool> docked = false;
  // Sends each state only after the force that answers the state before, or after 20 ms. Counts
  // then do not depend on the speed of the emulated bus.
  std::atomic<bool> waits_for_forces = false;
  std::atomic<int> queries_without_answer = 0;
  std::atomic<bool> break_mends = false;  // a device that is silent

  bool is_streaming() const { return streaming_; }  // the host has started its servo
  // All whole force frames, oldest first.
  std::vector<TouchForce> Forces() const {
    const std::scoped_lock lock(mutex());
    return forces_;
  }
  // The number of bytes that were not part of a frame.
  std::size_t garbage_bytes() const {
    const std::scoped_lock lock(mutex());
    return parser_.corrupt_bytes();
  }

 private:
  void OnPlugged() override;
  std::optional<std::size_t> OnControl(const UsbSetup& setup,
                                       std::span<std::uint8_t> data) override;
  void OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) override;
  void OnMillisecond() override;

  void TakeFrame(std::uint8_t command, std::span<const std::uint8_t> payload);
  void Answer(OmniUsbCommand reply, const std::string& text);

  Path path_;
  std::uint32_t path_begin_ = 0;  // of counter_
  unsigned waited_ms_ = 0;
  OmniUsbParser parser_;
  std::atomic<bool> streaming_ = false;
  std::uint32_t counter_ = 0;
  std::array<int, 3> encoders_{};
  std::vector<TouchForce> forces_;
};

}  // namespace palpate::test
