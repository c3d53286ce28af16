// The frames of the Novint Falcon with Novint's firmware: 16 bytes in each direction. The Falcon
// answers each command with one report.
//
//   byte   0      1-4  5-8  9-12         13                      14   15
//         '<'    three 16-bit numbers    flags                   any  '>'
//
// A number is two's complement, as four nibbles, the lowest first. 0x41 is added to each nibble and
// to the flags. Flags of a command: bit 0 homing, bits 1-3 lights. Flags of a report: bits 0-3
// buttons of the grip, bits 4-6 homed encoders.
//
// Reports arrive through an FTDI chip. The chip starts each USB packet of 64 bytes with two status
// bytes.
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
  bool homing = false;      // encoders set their zero when they pass it

  bool operator==(const FalconCommand&) const = default;
};

struct FalconReport {
  std::array<std::int16_t, 3> encoders{};
  std::uint8_t buttons = 0;  // bit n: button n pressed; 0 to 15
  std::uint8_t homed = 0;    // bit n: encoder n is homed; 0 to 7

  bool is_homed() const { return homed == 7; }
  bool operator==(const FalconReport&) const = default;
};

// Cuts off bits that the fields cannot hold (lights, buttons, homed).
FalconFrame EncodeFalconCommand(const FalconCommand& command);
FalconFrame EncodeFalconReport(const FalconReport& report);

// Return none for other lengths and for bytes that cannot be in such a frame. Byte 14 may be any
// byte except '<' and '>', so that these two always mark an end of a frame.
std::optional<FalconCommand> DecodeFalconCommand(std::span<const std::uint8_t> bytes);
std::optional<FalconReport> DecodeFalconReport(std::span<const std::uint8_t> bytes);

// Finds frames of either direction in a stream of bytes.
class FalconFrameFinder {
 public:
  // Returns true if frame() is now a whole frame. The frame is valid until the next Push.
  bool Push(std::uint8_t byte);
  const FalconFrame& frame() const { return frame_; }
  // The number of broken frames, and of runs of bytes outside of frames.
  std::uint32_t corrupt_frames() const { return corrupt_frames_; }

 private:
  // kCounted: the bytes since the last whole frame are already in corrupt_frames_.
  enum class Gap : std::uint8_t { kClean, kCounted };

  FalconFrame frame_{};
  std::size_t length_ = 0;  // bytes of the frame so far; 0: between frames
  Gap gap_ = Gap::kClean;
  std::uint32_t corrupt_frames_ = 0;
};

// Calls take(byte) for each byte of an IN transfer, without the chip's status bytes. The transfer
// must start with a packet. Transfers of whole packets do.
template <typename Take>
void ForEachFtdiByte(std::span<const std::uint8_t> transfer, Take take) {
  for (std::size_t n = 0; n < transfer.size(); ++n) {
    if (n % kFtdiPacketBytes >= kFtdiStatusBytes) take(transfer[n]);
  }
}

}  // namespace palpate
