// An emulated Novint Falcon (USB 0403:cb48) for the tests: an FT232 serial chip with
// the arm's controller behind it.
//
// Facts, from libnifalcon's FalconCommLibUSB and FalconFirmwareNovintSDK:
// - The chip's IN packets begin with two bytes of modem status. When its latency time is up, it
//   sends these bytes alone.
// - Without firmware, the controller knows two greetings (0A 43 0D at 9600 baud, 41 at 140 000
//   baud) and echoes the firmware that it gets.
// - With firmware, it answers each 16-byte frame with a frame of its own.
// Our assumptions:
// - A rise of DTR restarts the greetings.
// - The controller runs its firmware as soon as the chip is set to the stream's baud rate.
// - It forgets the firmware when unplugged.
//
// Threads: as EmulatedUsbDevice.
#pragma once

#include <functional>

#include "tests/support/usb_emulator.h"

namespace palpate::test {

// A force frame as the device received it.
struct FalconForce {
  std::array<std::int16_t, 3> motors{};
  std::uint8_t lights = 0;  // LEDs, and the homing bit 0
  bool IsZero() const { return motors == std::array<std::int16_t, 3>{}; }
};

class FalconEmulator final : public EmulatedUsbDevice {
 public:
  static constexpr std::uint8_t kIn = 0x81, kOut = 0x02;

  FalconEmulator();

  // The encoders, by the number of the answer from now. A slow bus thus makes the arm slow, and
  // never makes it leap. They begin at 0.
  using Path = std::function<std::array<std::int16_t, 3>(int)>;
  void SetPath(Path path);

  Bytes firmware() const;  // as it was loaded
  std::vector<FalconForce> Forces() const;

 private:
  enum class Stage : std::uint8_t { kDumb, kGreeted, kLoading, kRunning };

  void OnPlugged() override;
  std::optional<std::size_t> OnControl(const UsbSetup& setup,
                                       std::span<std::uint8_t> data) override;
  void OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) override;
  void OnMillisecond() override;

  void TakeFrame(std::span<const std::uint8_t> frame);
  void Load(std::span<const std::uint8_t> bytes);
  Bytes Answer();

  Path path_;
  int path_answers_ = 0;

  Stage stage_ = Stage::kDumb;
  Bytes to_device_, from_device_, firmware_;
  int latency_ms_ = 16, quiet_ms_ = 0;
  std::uint16_t baud_divisor_ = 0;
  std::vector<FalconForce> forces_;
};

}  // namespace palpate::test
