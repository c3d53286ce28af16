// The simplest force-feedback device on USB: an emulated device, and its protocol. For tests of the
// code that all devices share. The device counts its readings and stores its forces.
//
// A reading is 5a, or 5b if it is not calibrated, a number, x in 0.01 mm as int16. A force is a5,
// whether the motors are on, x in 0.01 N as int16. Requests 1 and 2 start and end the readings.
#pragma once

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/device/usb/usb_bus.h"
#include "tests/support/usb_emulator.h"

namespace palpate::test {

constexpr std::uint8_t kPlainIn = 0x81;
constexpr std::uint8_t kPlainOut = 0x02;
constexpr std::uint8_t kPlainRequest = 0x40;  // a vendor request to the device
constexpr std::uint8_t kPlainStart = 1;
constexpr std::uint8_t kPlainEnd = 2;

struct PlainForce {
  std::int64_t time_ns = 0;
  bool motors_on = false;
  double x_n = 0.0;
};

class PlainStylus final : public EmulatedUsbDevice {
 public:
  // answers: sends a reading for each force, and not one every millisecond.
  explicit PlainStylus(bool answers = false) : EmulatedUsbDevice(Spec()), answers_(answers) {}

  std::atomic<bool> mute = false;  // no readings come; transfers still work
  std::atomic<bool> calibrated = true;
  std::atomic<bool> babbles = false;  // readings are longer than any transfer, so transfers fail

  std::vector<PlainForce> Forces() const {
    const std::scoped_lock lock(mutex());
    return forces_;
  }

 private:
  static UsbSpec Spec() {
    return {.vendor = 0x1209,
            .product = 0x0001,
            .interfaces = {{.device_class = 2,
                            .endpoints = {{.address = 0x83, .type = 3}},
                            .kernel_driver = "cdc_acm"},
                           {.device_class = 10,
                            .endpoints = {{.address = kPlainIn}, {.address = kPlainOut}}}}};
  }

  void OnPlugged() override { streams_ = false; }
  std::optional<std::size_t> OnControl(const UsbSetup& setup, std::span<std::uint8_t>) override {
    if (setup.request != kPlainStart && setup.request != kPlainEnd) return std::nullopt;
    streams_ = setup.request == kPlainStart;
    return 0;
  }
  void OnOut(std::uint8_t, std::span<const std::uint8_t> bytes) override {
    if (bytes.size() != 4 || bytes[0] != 0xa5) return;
    const auto x = static_cast<std::int16_t>(bytes[2] | bytes[3] << 8);
    forces_.push_back({.time_ns = NowNs(), .motors_on = bytes[1] != 0, .x_n = x / 100.0});
    if (answers_) Answer();
  }
  void OnMillisecond() override {
    if (!answers_) Answer();
  }
  void Answer() {
    if (!streams_ || mute) return;
    if (babbles) return QueueIn(kPlainIn, Bytes(1000));
    ++number_;
    const std::uint8_t start = calibrated ? 0x5a : 0x5b;
    QueueIn(kPlainIn,
            {start, number_, static_cast<std::uint8_t>(x_), static_cast<std::uint8_t>(x_ >> 8)});
    x_ = static_cast<std::int16_t>((x_ + 1) % 1000);
  }

  const bool answers_;
  bool streams_ = false;
  std::uint8_t number_ = 0;
  std::int16_t x_ = 0;
  std::vector<PlainForce> forces_;
};

class PlainProtocol final : public UsbProtocol {
 public:
  explicit PlainProtocol(bool answers = false) : answers_(answers) {
    spec_.kind = "plain";
    match_.ids = {{.vendor = 0x1209, .product = 0x0001}};
    match_.data_class = 10;
  }

  const DeviceDescription& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }

  std::string SetUp(UsbLink& link, const std::atomic<bool>&) override {
    link.Control(kPlainRequest, kPlainStart, 0, 0, {}, std::chrono::milliseconds(200));
    return "serial 7";
  }
  StreamReceived Receive(std::span<const std::uint8_t> bytes,
                         DeviceState& state) noexcept override {
    if (bytes.size() != 4 || (bytes[0] | 1) != 0x5b) return {.corrupt_frames = 1};
    state.calibrated = bytes[0] == 0x5a;
    state.p_MHip_mm.x() = static_cast<std::int16_t>(bytes[2] | bytes[3] << 8) / 100.0;
    const auto lost = static_cast<std::uint8_t>(bytes[1] - last_number_ - 1);
    last_number_ = bytes[1];
    return {.has_reading = true, .readings = 1, .lost_readings = lost};
  }
  std::size_t Encode(const DeviceCommand& command,
                     std::span<std::uint8_t, kMaxFrameBytes> out) noexcept override {
    const double x_n = command.motors_on ? command.wrench_M.force_n.x() : 0.0;
    const auto x = static_cast<std::int16_t>(std::lround(x_n * 100.0));
    out[0] = 0xa5;
    out[1] = command.motors_on ? 1 : 0;
    out[2] = static_cast<std::uint8_t>(x);
    out[3] = static_cast<std::uint8_t>(x >> 8);
    return 4;
  }
  bool is_request_response() const override { return answers_; }
  const char* calibration_hint() const noexcept override { return "no hint"; }
  void TearDown(UsbLink& link) noexcept override {
    try {
      link.Control(kPlainRequest, kPlainEnd, 0, 0, {}, std::chrono::milliseconds(50));
    } catch (const BusError&) {
      // It is gone.
    }
  }

 private:
  const bool answers_;
  std::uint8_t last_number_ = 0;
  DeviceDescription spec_;
  UsbMatch match_;
};

}  // namespace palpate::test
