// Frames as an Omni would send them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/device/omni/omni_frames.h"

namespace palpate::test {

struct OmniReading {
  std::array<int, 3> encoders{};
  // The gimbal's voltages A in parts of 1000; B = 1000 - A.
  std::array<int, 3> gimbal_per_mille = {500, 500, 500};
  unsigned pressed = 0;  // bit n: button n
  bool docked = false;
  std::uint32_t counter = 0;
};

inline std::vector<std::uint8_t> OmniStatePayload(const OmniReading& reading) {
  std::vector<std::uint8_t> bytes(kOmniStateBytes, 0);
  const auto put = [&](std::size_t at, unsigned word) {
    bytes[at] = static_cast<std::uint8_t>(word);
    bytes[at + 1] = static_cast<std::uint8_t>(word >> 8);
  };
  for (std::size_t n = 0; n < 3; ++n) {
    put(4 + 2 * n, static_cast<unsigned>(reading.encoders[n]));
    put(10 + 2 * n, static_cast<unsigned>(reading.gimbal_per_mille[n]));
    put(22 + 2 * n, static_cast<unsigned>(1000 - reading.gimbal_per_mille[n]));
  }
  // Buttons and dock are active low.
  bytes[19] = static_cast<std::uint8_t>((~reading.pressed & 3u) | (reading.docked ? 0u : 4u));
  put(32, reading.counter);
  put(34, reading.counter >> 16);
  return bytes;
}

inline std::vector<std::uint8_t> Framed(std::uint8_t command,
                                        std::span<const std::uint8_t> payload) {
  std::vector<std::uint8_t> frame(kOmniUsbMaxFrameBytes);
  frame.resize(EncodeOmniUsbFrame(command, payload, frame));
  return frame;
}

}  // namespace palpate::test
