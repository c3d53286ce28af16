// UsbLink without USB: a test that links scripted_usb_link.cpp and not palpate::usb
// answers what a protocol sends.
//
// Threads: one. Not for streams: StartStream and what belongs to it do nothing.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "server/device/usb/usb_link.h"

namespace palpate::test {

struct ScriptedUsb {
  struct Request {
    std::uint8_t request_type = 0;
    std::uint8_t request = 0;
    std::uint16_t value = 0;
    std::uint16_t index = 0;
    std::vector<std::uint8_t> data{};
  };

  UsbFound found{};
  // Answers a control request: fills `data`, returns its bytes; may throw UsbError.
  std::function<std::size_t(const Request&, std::span<std::uint8_t> data)> control{};
  // Takes what is sent; may throw UsbError.
  std::function<void(const std::vector<std::uint8_t>&)> send{};
  // What comes in, a transfer each; none: a timeout.
  std::deque<std::vector<std::uint8_t>> in{};
  // In its place: a transfer of at most that size; empty: a timeout, at once.
  std::function<std::vector<std::uint8_t>(std::size_t)> receive{};

  std::vector<Request> requests{};
  std::vector<std::vector<std::uint8_t>> sent{};
};

// The UsbLinks that are made from now on talk to this one.
void SetScriptedUsb(ScriptedUsb& script);

}  // namespace palpate::test
