#include "server/device/omni/omni_frames.h"

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

namespace {

constexpr std::array<std::uint8_t, 2> kStart = {0xa5, 0x5a};

}  // namespace

std::size_t EncodeOmniUsbFrame(std::uint8_t command, std::span<const std::uint8_t> payload,
                               std::span<std::uint8_t> out) noexcept {
  const std::size_t bytes = kOmniUsbHeaderBytes + payload.size();
  if (payload.size() > kOmniUsbMaxPayloadBytes || out.size() < bytes) return 0;
  out[0] = kStart[0];
  out[1] = kStart[1];
  out[2] = command;
  out[3] = static_cast<std::uint8_t>(payload.size());
  std::copy(payload.begin(), payload.end(), out.begin() + kOmniUsbHeaderBytes);
  return bytes;
}

void OmniUsbParser::Reset() noexcept {
  held_bytes_ = 0;
  frame_is_out_ = false;
  in_run_ = false;
}

std::optional<OmniUsbFrame> OmniUsbParser::Next(std::span<const std::uint8_t>& bytes) noexcept {
  if (frame_is_out_) {
    frame_is_out_ = false;
    held_bytes_ = 0;
  }
  for (;;) {
    // Takes no more bytes than the header is known to announce. If the frame is wrong, only these
    // few bytes are searched again.
    const bool has_header = held_bytes_ >= kOmniUsbHeaderBytes;
    const std::size_t wanted = has_header ? kOmniUsbHeaderBytes + held_[3] : kOmniUsbHeaderBytes;
    const std::size_t taken = std::min(wanted - held_bytes_, bytes.size());
    std::copy_n(bytes.begin(), taken, held_.begin() + held_bytes_);
    held_bytes_ += taken;
    bytes = bytes.subspan(taken);
    if (!HeaderFits()) {
      const auto next = std::find(held_.begin() + 1, held_.begin() + held_bytes_, kStart[0]);
      Drop(static_cast<std::size_t>(next - held_.begin()));
    } else if (held_bytes_ < wanted) {
      return std::nullopt;
    } else if (has_header || held_[3] == 0) {
      frame_is_out_ = true;
      in_run_ = false;
      return OmniUsbFrame{.command = held_[2],
                          .payload = std::span(held_).subspan(kOmniUsbHeaderBytes, held_[3])};
    }
  }
}

// True if the bytes so far may begin a header.
bool OmniUsbParser::HeaderFits() const noexcept {
  for (std::size_t n = 0; n < std::min(held_bytes_, kStart.size()); ++n) {
    if (held_[n] != kStart[n]) return false;
  }
  return true;
}

void OmniUsbParser::Drop(std::size_t bytes) noexcept {
  corrupt_bytes_ += bytes;
  if (!in_run_) ++corrupt_runs_;
  in_run_ = true;
  std::copy(held_.begin() + bytes, held_.begin() + held_bytes_, held_.begin());
  held_bytes_ -= bytes;
}

}  // namespace palpate
