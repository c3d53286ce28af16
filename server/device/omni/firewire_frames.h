// The frames of the FireWire Phantom Omni, taken from two independent open drivers: 44 bytes from
// the device, and up to 20 more whose meaning is unknown; 16 bytes to it.
//
// The USB devices' servo frames are not public. We have no evidence that they have this layout: no
// transport uses this codec for USB. Verification level of this layout: none; we have not seen a
// device.
//
// Numbers are little-endian. The force of a motor count is not public either, so motors are in
// counts here.
// Threads: pure functions. Real-time: no allocation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace palpate {

inline constexpr std::size_t kOmniStateBytes = 44;
inline constexpr std::size_t kOmniMostStateBytes = 64;
inline constexpr std::size_t kOmniForceBytes = 16;
inline constexpr int kOmniMotorRange = 0x7ff;  // counts either way

struct OmniState {
  std::array<std::int16_t, 3> encoders{};
  // Angles of the gimbal from its potentiometers.
  std::array<double, 3> gimbal_rad{};
  std::array<bool, 2> buttons{};
  bool docked = false;
  std::uint32_t counter = 0;  // rises with every frame
};

// Returns none for a frame of another length, or with a gimbal voltage of 0.
std::optional<OmniState> DecodeOmniState(std::span<const std::uint8_t> bytes);

struct OmniForce {
  std::array<int, 3> motors{};  // counts, held within kOmniMotorRange
  bool force_enabled = false;
  std::uint8_t dock_light = 0;  // 0 to 3
};

std::array<std::uint8_t, kOmniForceBytes> EncodeOmniForce(const OmniForce& force);

}  // namespace palpate
