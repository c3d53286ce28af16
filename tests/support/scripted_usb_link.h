// UsbLink without USB. A test links scripted_usb_link.cpp instead of palpate::usb, and answers what
// a protocol sends.
//
// Threads: one. Not for streams: StartStream and the functions for streams do nothing.
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
  // Takes sent data; may throw UsbError.
  std::function<void(const std::vector<std::uint8_t>&)> send{};
  // Incoming transfers; empty: a timeout.
  std::deque<std::vector<std::uint8_t>> in{};
  // Replaces `in`: returns a transfer of at most this size; an empty one is an immediate timeout.
  std::function<std::vector<std::uint8_t>(std::size_t)> receive{};

  std::vector<Request> requests{};
  std::vector<std::vector<std::uint8_t>> sent{};
};

// All UsbLinks made from now on use this script.
void SetScriptedUsb(ScriptedUsb& script);

}  // namespace palpate::test
