// The framing of the Touch's serial line over USB: A5 5A, a command, the length of the
// payload, the payload. No checksum.
//
// Source: one published trace of one device; verification level none. What the trace
// has are the queries and the start below. The frames that carry positions and forces
// are not public: what their command bytes are, and what is in them.
//
// Threads: one. Real-time: no allocation, bounded. Errors: none; what is no frame is
// counted.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace palpate {

inline constexpr std::size_t kOmniUsbHeaderBytes = 4;
inline constexpr std::size_t kOmniUsbMaxPayloadBytes = 255;
inline constexpr std::size_t kOmniUsbMaxFrameBytes = kOmniUsbHeaderBytes + kOmniUsbMaxPayloadBytes;

struct OmniUsbCommand {
  std::uint8_t command = 0;
  std::uint8_t payload_bytes = 0;
};

// Each has been seen once, in the trace; its meaning is the trace's author's reading.
// To the device: 32 zero bytes, a zero byte, 60 bytes that are not public, and the 7
// bytes below.
inline constexpr OmniUsbCommand kOmniUsbFirmwareQuery{0x0f, 32};
inline constexpr OmniUsbCommand kOmniUsbSerialQuery{0x0c, 1};
inline constexpr OmniUsbCommand kOmniUsbInit{0x04, 60};
inline constexpr OmniUsbCommand kOmniUsbServo{0x07, 7};
// From the device. That the text is printable, and where, is our guess.
inline constexpr OmniUsbCommand kOmniUsbFirmwareReply{0x0e, 32};
inline constexpr OmniUsbCommand kOmniUsbSerialReply{0x09, 97};

inline constexpr std::array<std::uint8_t, 7> kOmniUsbServoOn = {0x01, 0, 0, 0x80, 0, 0, 0};
// Our guess: the first byte is the switch. The trace does not show it.
inline constexpr std::array<std::uint8_t, 7> kOmniUsbServoOff = {0x00, 0, 0, 0x80, 0, 0, 0};

// Bytes of the frame; 0, and nothing is written, where the payload is too long or
// `out` too short.
std::size_t EncodeOmniUsbFrame(std::uint8_t command, std::span<const std::uint8_t> payload,
                               std::span<std::uint8_t> out) noexcept;

struct OmniUsbFrame {
  std::uint8_t command = 0;
  std::span<const std::uint8_t> payload{};  // in the parser: valid until its next call
};

// Frames out of a stream of bytes that is cut anywhere. What it finds depends on the
// bytes and not on the cuts.
//
// Without a checksum a damaged payload passes, and a damaged length takes the frames
// after it along, at most 255 bytes. Commands whose length is known bound that: with
// another length their header is taken for garbage, and the search for the next
// header starts right behind its first byte; and one with its own header in its
// payload is two, of which the first was cut off.
class OmniUsbParser {
 public:
  // From now on the command has this length. Others may have any.
  void Expect(OmniUsbCommand command) noexcept;

  // The next whole frame, with as many of `bytes` as it takes; they are cut off. None:
  // all are taken.
  std::optional<OmniUsbFrame> Next(std::span<const std::uint8_t>& bytes) noexcept;

  // Forgets what is left of a frame; the counts and the known lengths stay.
  void Reset() noexcept;

  // Bytes that were in no frame, and unbroken runs of such bytes.
  std::uint64_t corrupt_bytes() const { return corrupt_bytes_; }
  std::uint64_t corrupt_runs() const { return corrupt_runs_; }

 private:
  bool HeaderFits() const noexcept;
  std::size_t InnerFrame() const noexcept;
  void Drop(std::size_t bytes) noexcept;

  std::array<std::uint8_t, kOmniUsbMaxFrameBytes> held_{};
  std::size_t held_bytes_ = 0;
  bool frame_is_out_ = false;  // held_ is the frame that was returned last
  bool in_run_ = false;
  std::uint64_t corrupt_bytes_ = 0;
  std::uint64_t corrupt_runs_ = 0;
  // Known length + 1 of each command; 0: any.
  std::array<std::uint16_t, 256> lengths_{};
};

}  // namespace palpate
