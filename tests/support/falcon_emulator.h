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

#include <atomic>
#include <functional>
#include <utility>

#include "server/device/falcon/frames.h"
#include "tests/support/usb_emulator.h"

namespace palpate::test {

class FalconEmulator final : public EmulatedUsbDevice {
 public:
  static constexpr std::uint8_t kIn = 0x81, kOut = 0x02;

  FalconEmulator();

  // The encoders, by the number of the answer from now. A slow bus thus makes the arm slow, and
  // never makes it leap. They begin at 0.
  using Path = std::function<std::array<std::int16_t, 3>(int)>;
  void SetPath(Path path) {
    const std::scoped_lock lock(mutex());
    path_ = std::move(path);
    path_answers_ = 0;
  }

  void SetFirmware(Bytes firmware) {
    const std::scoped_lock lock(mutex());
    firmware_ = std::move(firmware);
  }
  // As it was loaded.
  Bytes firmware() const {
    const std::scoped_lock lock(mutex());
    return firmware_;
  }
  // The commands as the device received them, oldest first.
  std::vector<FalconCommand> Forces() const {
    const std::scoped_lock lock(mutex());
    return forces_;
  }

  std::atomic<bool> spoils_echo = false;  // of the firmware's later part
  std::atomic<bool> cannot_run = false;   // the firmware is not for it
  std::atomic<int> commands_without_answer = 0;
  std::atomic<std::uint8_t> buttons = 0;  // of the grip, pressed now

 private:
  enum class Stage : std::uint8_t { kDumb, kGreeted, kLoading, kRunning };

  void OnPlugged() override;
  std::optional<std::size_t> OnControl(const UsbSetup& setup,
                                       std::span<std::uint8_t> data) override;
  void OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) override;
  void OnMillisecond() override;

  void Load(Bytes bytes);
  void TakeCommand(const FalconCommand& command);

  Path path_;
  int path_answers_ = 0;

  Stage stage_ = Stage::kDumb;
  Bytes to_device_, from_device_, firmware_;
  int latency_ms_ = 16, quiet_ms_ = 0;
  std::uint16_t baud_divisor_ = 0;
  std::vector<FalconCommand> forces_;
};

}  // namespace palpate::test
