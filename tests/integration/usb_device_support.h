// Shared by the tests of UsbDevice: a device on the emulated bus, and a loop like the servo's.
//
// The emulation proves behaviour, not timing.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/device/usb/usb_device.h"
#include "tests/support/plain_stylus.h"

namespace palpate::test {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;

inline bool Eventually(const std::function<bool()>& is_so, milliseconds patience = seconds(5)) {
  const steady_clock::time_point deadline = steady_clock::now() + patience;
  while (steady_clock::now() < deadline) {
    if (is_so()) return true;
    std::this_thread::sleep_for(milliseconds(1));
  }
  return is_so();
}

inline std::unique_ptr<UsbDevice> MakeDevice(bool answers = false) {
  return std::make_unique<UsbDevice>(std::make_unique<PlainProtocol>(answers), 0);
}

inline bool Streams(const UsbDevice& device) {
  return device.health().connection == DeviceConnection::kStreaming;
}

inline std::vector<std::string> Log(UsbDevice& device) {
  std::vector<std::string> lines;
  while (const std::optional<DeviceEvent> event = device.NextEvent()) lines.push_back(event->text);
  return lines;
}

// Reads and writes once a millisecond, as the servo does. Returns all statuses, oldest first.
inline std::vector<DeviceStatus> Serve(UsbDevice& device, milliseconds time, double force_x_n) {
  std::vector<DeviceStatus> statuses;
  DeviceState state;
  steady_clock::time_point next = steady_clock::now();
  const steady_clock::time_point end = next + time;
  while (next < end) {
    statuses.push_back(device.Read(state));
    device.SetMotors(true);
    // The safety stage does the same after a halt of this machine.
    const bool is_held = statuses.back() == DeviceStatus::kStale;
    device.Write({is_held ? 0.0 : force_x_n, 0.0, 0.0}, 0.001);
    next += milliseconds(1);
    std::this_thread::sleep_until(next);
  }
  return statuses;
}

inline std::size_t Count(const std::vector<DeviceStatus>& statuses, DeviceStatus status) {
  return static_cast<std::size_t>(std::count(statuses.begin(), statuses.end(), status));
}

inline bool IsOn(const PlainForce& force) { return force.motors_on; }

inline bool IsHalt(const std::string& line) {
  return line.starts_with("plain: no reading for") || line.starts_with("plain: no force taken for");
}

// A halt of this machine may look like a halt of the device. Removes such lines and the
// reconnections after them. Returns the number of removed pairs.
inline std::uint64_t TakeHalts(std::vector<std::string>& lines) {
  std::uint64_t halts = 0;
  // Before the first connection, no reconnection follows.
  while (!lines.empty() && IsHalt(lines.front())) lines.erase(lines.begin());
  for (std::size_t i = 0; i + 1 < lines.size();) {
    if (!IsHalt(lines[i]) || lines[i + 1].find(": connected") == std::string::npos) {
      ++i;
      continue;
    }
    lines.erase(lines.begin() + static_cast<std::ptrdiff_t>(i),
                lines.begin() + static_cast<std::ptrdiff_t>(i) + 2);
    ++halts;
  }
  return halts;
}

inline std::vector<std::string> LogWithoutHalts(UsbDevice& device) {
  std::vector<std::string> lines = Log(device);
  TakeHalts(lines);
  return lines;
}

inline const std::vector<std::string> kConnected = {"plain on USB port 1-1: connected, serial 7"};

}  // namespace palpate::test
