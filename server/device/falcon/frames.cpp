#include "server/device/falcon/frames.h"

namespace palpate {
namespace {

constexpr std::uint8_t kBegin = '<', kEnd = '>', kBase = 0x41;
constexpr std::size_t kFlagsAt = 13, kUnusedAt = 14, kEndAt = 15;
constexpr unsigned kHomingFlag = 1u, kLightsMask = 0xeu, kButtonsMask = 0xfu, kHomedMask = 7u;

// True if a frame of either direction may have `byte` at position `at`.
bool IsPlausible(std::size_t at, std::uint8_t byte) {
  if (at == 0) return byte == kBegin;
  if (at == kEndAt) return byte == kEnd;
  if (at == kUnusedAt) return byte != kBegin && byte != kEnd;
  return byte >= kBase && byte < kBase + (at == kFlagsAt ? 0x80 : 0x10);
}

bool IsFrame(std::span<const std::uint8_t> bytes) {
  if (bytes.size() != kFalconFrameBytes) return false;
  for (std::size_t at = 0; at < kFalconFrameBytes; ++at) {
    if (!IsPlausible(at, bytes[at])) return false;
  }
  return true;
}

FalconFrame Encode(const std::array<std::int16_t, 3>& numbers, unsigned flags) {
  FalconFrame frame{};
  frame[0] = kBegin;
  for (std::size_t n = 0; n < 3; ++n) {
    const auto bits = static_cast<std::uint16_t>(numbers[n]);
    for (std::size_t nibble = 0; nibble < 4; ++nibble) {
      frame[1 + 4 * n + nibble] = static_cast<std::uint8_t>(kBase + (bits >> 4 * nibble & 0xfu));
    }
  }
  frame[kFlagsAt] = static_cast<std::uint8_t>(kBase + flags);
  frame[kUnusedAt] = kBase;
  frame[kEndAt] = kEnd;
  return frame;
}

std::array<std::int16_t, 3> Numbers(std::span<const std::uint8_t> frame) {
  std::array<std::int16_t, 3> numbers{};
  for (std::size_t n = 0; n < 3; ++n) {
    unsigned bits = 0;
    for (std::size_t nibble = 0; nibble < 4; ++nibble) {
      bits |= static_cast<unsigned>(frame[1 + 4 * n + nibble] - kBase) << 4 * nibble;
    }
    numbers[n] = static_cast<std::int16_t>(bits);
  }
  return numbers;
}

}  // namespace

FalconFrame EncodeFalconCommand(const FalconCommand& command) {
  return Encode(command.motors,
                (command.lights & kLightsMask) | (command.homing ? kHomingFlag : 0));
}

FalconFrame EncodeFalconReport(const FalconReport& report) {
  return Encode(report.encoders, (report.buttons & kButtonsMask) | (report.homed & kHomedMask)
                                                                       << 4);
}

std::optional<FalconCommand> DecodeFalconCommand(std::span<const std::uint8_t> bytes) {
  if (!IsFrame(bytes) || bytes[kFlagsAt] - kBase > 0xf) return std::nullopt;
  const unsigned flags = bytes[kFlagsAt] - kBase;
  return FalconCommand{.motors = Numbers(bytes),
                       .lights = static_cast<std::uint8_t>(flags & kLightsMask),
                       .homing = (flags & kHomingFlag) != 0};
}

std::optional<FalconReport> DecodeFalconReport(std::span<const std::uint8_t> bytes) {
  if (!IsFrame(bytes)) return std::nullopt;
  const unsigned flags = bytes[kFlagsAt] - kBase;
  return FalconReport{.encoders = Numbers(bytes),
                      .buttons = static_cast<std::uint8_t>(flags & kButtonsMask),
                      .homed = static_cast<std::uint8_t>(flags >> 4 & kHomedMask)};
}

bool FalconFrameFinder::Push(std::uint8_t byte) {
  if (byte == kBegin) {
    if (length_ > 0) ++corrupt_frames_;
    frame_[0] = byte;
    length_ = 1;
    return false;
  }
  if (length_ == 0 || !IsPlausible(length_, byte)) {
    if (length_ > 0 || gap_ == Gap::kClean) ++corrupt_frames_;
    length_ = 0;
    gap_ = Gap::kCounted;
    return false;
  }
  frame_[length_++] = byte;
  if (length_ < kFalconFrameBytes) return false;
  length_ = 0;
  gap_ = Gap::kClean;
  return true;
}

}  // namespace palpate
