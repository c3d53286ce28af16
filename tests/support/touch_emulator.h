// An emulated Touch (USB 2988:0302, CDC-ACM) for the tests.
//
// From one published trace: the framing A5 5A command length payload, the firmware
// query 0F 20 and its answer 0E 20, the serial query 0C 01 and its answer 09 61.
// Endpoints and their addresses are invented, and so is the order of its interfaces. This emulator
// says nothing about real devices.
//
// Threads: as EmulatedUsbDevice.
#pragma once

#include <atomic>
#include <string>

#include "server/device/omni/omni_frames.h"
#include "tests/support/usb_emulator.h"

namespace palpate::test {

class TouchEmulator final : public EmulatedUsbDevice {
 public:
  static constexpr std::uint8_t kNotify = 0x81, kDataIn = 0x82, kDataOut = 0x03;
  static constexpr std::uint8_t kControlInterface = 1;

  TouchEmulator();

  std::atomic<int> queries_without_answer = 0;
  std::atomic<bool> break_mends = false;  // a device that is silent

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
  void OnMillisecond() override {}

  void TakeFrame(std::uint8_t command);
  void Answer(OmniUsbCommand reply, const std::string& text);

  OmniUsbParser parser_;
};

}  // namespace palpate::test
