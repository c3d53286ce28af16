#include "server/device/omni/firewire_frames.h"

#include <algorithm>

namespace palpate {
namespace {

constexpr std::size_t kEncodersAt = 4, kGimbalAAt = 10, kStatusAt = 19, kGimbalBAt = 22,
                      kCounterAt = 32;
constexpr std::array<double, 3> kGimbalSlope = {5.48, -5.28, 4.76};
constexpr std::array<double, 3> kGimbalOffsetRad = {-2.74, 2.64, -2.38};

constexpr unsigned kButton0 = 1u << 0, kButton1 = 1u << 1, kDocked = 1u << 2;  // active low

constexpr unsigned kStatusBase = 0x53c0, kForceEnable = 1u << 3, kDockLight = 3u;

std::uint16_t Word(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
}

void PutWord(unsigned word, std::size_t at, std::span<std::uint8_t> bytes) {
  bytes[at] = static_cast<std::uint8_t>(word);
  bytes[at + 1] = static_cast<std::uint8_t>(word >> 8);
}

}  // namespace

std::optional<OmniState> DecodeOmniState(std::span<const std::uint8_t> bytes) {
  if (bytes.size() < kOmniStateBytes || bytes.size() > kOmniMostStateBytes) return std::nullopt;
  OmniState state;
  for (std::size_t n = 0; n < 3; ++n) {
    state.encoders[n] = static_cast<std::int16_t>(Word(bytes, kEncodersAt + 2 * n));
    const double a = Word(bytes, kGimbalAAt + 2 * n), b = Word(bytes, kGimbalBAt + 2 * n);
    if (!(a + b > 0.0)) return std::nullopt;
    state.gimbal_rad[n] = kGimbalSlope[n] * (a / (a + b)) + kGimbalOffsetRad[n];
  }
  const unsigned status = bytes[kStatusAt];
  state.buttons = {(status & kButton0) == 0, (status & kButton1) == 0};
  state.docked = (status & kDocked) == 0;
  state.counter = Word(bytes, kCounterAt) | std::uint32_t{Word(bytes, kCounterAt + 2)} << 16;
  return state;
}

std::array<std::uint8_t, kOmniForceBytes> EncodeOmniForce(const OmniForce& force) {
  std::array<std::uint8_t, kOmniForceBytes> bytes{};
  for (std::size_t n = 0; n < 3; ++n) {
    const int counts = std::clamp(force.motors[n], -kOmniMotorRange, kOmniMotorRange);
    PutWord(static_cast<unsigned>(counts + kOmniMotorRange), 2 * n, bytes);
  }
  PutWord(kStatusBase | (force.force_enabled ? kForceEnable : 0u) | (force.dock_light & kDockLight),
          6, bytes);
  return bytes;
}

}  // namespace palpate
