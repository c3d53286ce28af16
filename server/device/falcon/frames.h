// The frames of the Novint Falcon under Novint's firmware: 16 bytes either way, each
// command answered with one report.
//
//   byte   0      1-4  5-8  9-12         13                      14   15
//         '<'    three 16-bit numbers    flags                   any  '>'
//
// A number is two's complement, four nibbles, the lowest first, each with 0x41 added.
// Flags, with 0x41 added. Command: bit 0 homing, bits 1-3 the lights. Report: bits 0-3
// the grip's buttons, bits 4-6 which encoders are homed.
//
// Reports arrive through an FTDI chip, which starts each USB packet of 64 bytes with
// two status bytes of its own.
//
// Source: libnifalcon (BSD), FalconFirmwareNovintSDK.cpp, FalconFirmware.h,
// FalconCommLibUSB.cpp. Verification level of this layout: none; we have not seen a
// device.
// Threads: plain functions and values. Real-time: no allocation, bounded.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace palpate {

inline constexpr std::size_t kFalconFrameBytes = 16;
inline constexpr std::size_t kFtdiPacketBytes = 64;
inline constexpr std::size_t kFtdiStatusBytes = 2;

inline constexpr std::uint8_t kFalconGreenLight = 1u << 1;
inline constexpr std::uint8_t kFalconBlueLight = 1u << 2;
inline constexpr std::uint8_t kFalconRedLight = 1u << 3;

using FalconFrame = std::array<std::uint8_t, kFalconFrameBytes>;

struct FalconCommand {
  std::array<std::int16_t, 3> motors{};
  std::uint8_t lights = 0;  // kFalcon...Light
  bool homing = false;      // encoders find their zero when they pass it

  bool operator==(const FalconCommand&) const = default;
};

struct FalconReport {
  std::array<std::int16_t, 3> encoders{};
  std::uint8_t buttons = 0;  // bit n: button n pressed; 0 to 15
  std::uint8_t homed = 0;    // bit n: encoder n; 0 to 7

  bool is_homed() const { return homed == 7; }
  bool operator==(const FalconReport&) const = default;
};

// What the fields do not hold (lights, buttons, homed beyond their bits) is cut off.
FalconFrame EncodeFalconCommand(const FalconCommand& command);
FalconFrame EncodeFalconReport(const FalconReport& report);

// None for other lengths and for bytes that no such frame has. Byte 14 may be all
// but '<' and '>', so that each of these is an end of a frame and nothing else.
std::optional<FalconCommand> DecodeFalconCommand(std::span<const std::uint8_t> bytes);
std::optional<FalconReport> DecodeFalconReport(std::span<const std::uint8_t> bytes);

// Finds frames in a stream of bytes: those of either direction.
class FalconFrameFinder {
 public:
  // True: frame() is a whole frame, until the next byte.
  bool Push(std::uint8_t byte);
  const FalconFrame& frame() const { return frame_; }
  // Frames that broke, and runs of bytes outside of frames.
  std::uint32_t corrupt_frames() const { return corrupt_frames_; }

 private:
  // Of a whole frame, or of what is left of a broken one that was counted already.
  enum class Gap : std::uint8_t { kClean, kCounted };

  FalconFrame frame_{};
  std::size_t length_ = 0;  // of the frame so far; 0: between frames
  Gap gap_ = Gap::kClean;
  std::uint32_t corrupt_frames_ = 0;
};

// Calls take(byte) for each byte of an IN transfer that is not of the chip's status.
// The transfer starts with a packet, as all transfers do that hold whole packets.
template <typename Take>
void ForEachFtdiByte(std::span<const std::uint8_t> transfer, Take take) {
  for (std::size_t n = 0; n < transfer.size(); ++n) {
    if (n % kFtdiPacketBytes >= kFtdiStatusBytes) take(transfer[n]);
  }
}

}  // namespace palpate
