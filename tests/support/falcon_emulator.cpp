#include "tests/support/falcon_emulator.h"

#include <algorithm>

namespace palpate::test {
namespace {

constexpr std::uint8_t kAllHomed = 7;

// FTDI's vendor requests.
constexpr std::uint8_t kReset = 0, kModemControl = 1, kSetBaudRate = 3, kSetLatency = 9;
constexpr std::uint16_t kPurgeFromDevice = 1, kPurgeToDevice = 2;
constexpr std::uint16_t kDtrHigh = 0x101;
constexpr std::uint16_t k9600Baud = 0x4138, k140000Baud = 0x15, kStreamBaud = 2;

const Bytes kGreeting = {0x0a, 0x43, 0x0d}, kGreetingAnswer = {0x00, 0x0a, 0x44, 0x2c, 0x0d};
constexpr std::uint8_t kSecondGreeting = 0x41;

UsbSpec FalconSpec() {
  return {.vendor = 0x0403,
          .product = 0xcb48,
          .interfaces = {
              {.subclass = 0xff,
               .protocol = 0xff,
               .endpoints = {{.address = FalconEmulator::kIn}, {.address = FalconEmulator::kOut}},
               .kernel_driver = "ftdi_sio"}}};
}

}  // namespace

FalconEmulator::FalconEmulator() : EmulatedUsbDevice(FalconSpec()) {}

void FalconEmulator::OnPlugged() {
  stage_ = Stage::kDumb;
  to_device_.clear();
  from_device_.clear();
  firmware_.clear();
  latency_ms_ = 16;
  baud_divisor_ = 0;
}

std::optional<std::size_t> FalconEmulator::OnControl(const UsbSetup& setup,
                                                     std::span<std::uint8_t> data) {
  if (setup.request_type != 0x40) return std::nullopt;
  if (setup.request == kReset && setup.value != kPurgeToDevice) from_device_.clear();
  if (setup.request == kReset && setup.value != kPurgeFromDevice) to_device_.clear();
  if (setup.request == kSetLatency) latency_ms_ = std::max(1, static_cast<int>(setup.value));
  if (setup.request == kModemControl && setup.value == kDtrHigh && stage_ != Stage::kRunning) {
    stage_ = Stage::kDumb;
    firmware_.clear();
  }
  if (setup.request == kSetBaudRate) {
    baud_divisor_ = setup.value;
    to_device_.clear();
    if (baud_divisor_ == kStreamBaud && !firmware_.empty()) {
      stage_ = cannot_run ? Stage::kDumb : Stage::kRunning;
    }
  }
  return data.size();
}

void FalconEmulator::OnOut(std::uint8_t endpoint, std::span<const std::uint8_t> bytes) {
  if (endpoint != kOut) return;
  if (stage_ == Stage::kLoading) return Load({bytes.begin(), bytes.end()});
  to_device_.insert(to_device_.end(), bytes.begin(), bytes.end());
  if (stage_ == Stage::kDumb && baud_divisor_ == k9600Baud && to_device_ == kGreeting) {
    from_device_ = kGreetingAnswer;
    stage_ = Stage::kGreeted;
    to_device_.clear();
  } else if (stage_ == Stage::kGreeted && baud_divisor_ == k140000Baud &&
             to_device_ == Bytes{kSecondGreeting}) {
    from_device_ = {kSecondGreeting};
    stage_ = Stage::kLoading;
    to_device_.clear();
  } else if (stage_ == Stage::kRunning && baud_divisor_ == kStreamBaud) {
    while (to_device_.size() >= kFalconFrameBytes) {
      const auto command = DecodeFalconCommand(std::span(to_device_).first(kFalconFrameBytes));
      if (command) TakeCommand(*command);
      to_device_.erase(to_device_.begin(), to_device_.begin() + kFalconFrameBytes);
    }
  } else {
    to_device_.clear();  // not understood
  }
}

void FalconEmulator::Load(Bytes bytes) {
  firmware_.insert(firmware_.end(), bytes.begin(), bytes.end());
  if (spoils_echo && firmware_.size() > 1000) bytes[0] ^= 1;
  from_device_.insert(from_device_.end(), bytes.begin(), bytes.end());
}

void FalconEmulator::TakeCommand(const FalconCommand& command) {
  forces_.push_back(command);
  if (commands_without_answer-- > 0) return;
  FalconReport report{.buttons = buttons, .homed = kAllHomed};
  if (path_) report.encoders = path_(path_answers_++);
  const FalconFrame answer = EncodeFalconReport(report);
  from_device_.insert(from_device_.end(), answer.begin(), answer.end());
}

void FalconEmulator::OnMillisecond() {
  ++quiet_ms_;
  if (from_device_.empty() && (quiet_ms_ < latency_ms_ || !IsInEmpty(kIn))) return;
  quiet_ms_ = 0;
  do {
    const std::size_t count = std::min(from_device_.size(), kFtdiPacketBytes - kFtdiStatusBytes);
    Bytes packet = {0x01, 0x60};
    packet.insert(packet.end(), from_device_.begin(),
                  from_device_.begin() + static_cast<std::ptrdiff_t>(count));
    from_device_.erase(from_device_.begin(),
                       from_device_.begin() + static_cast<std::ptrdiff_t>(count));
    QueueIn(kIn, std::move(packet));
  } while (!from_device_.empty());
}

}  // namespace palpate::test
