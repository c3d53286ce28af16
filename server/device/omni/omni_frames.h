// The frames of the Phantom Omni, on FireWire and on USB.
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

inline constexpr std::size_t kOmniUsbHeaderBytes = 4;
inline constexpr std::size_t kOmniUsbMaxPayloadBytes = 255;
inline constexpr std::size_t kOmniUsbMaxFrameBytes = kOmniUsbHeaderBytes + kOmniUsbMaxPayloadBytes;

struct OmniUsbCommand {
  std::uint8_t command = 0;
  std::uint8_t payload_bytes = 0;
};

// The trace shows each of these once; the meaning is as the trace's author reads it. To the device:
// 32 zero bytes, one zero byte, 60 bytes that are not public, and the 7 bytes below.
inline constexpr OmniUsbCommand kOmniUsbFirmwareQuery{0x0f, 32};
inline constexpr OmniUsbCommand kOmniUsbSerialQuery{0x0c, 1};
inline constexpr OmniUsbCommand kOmniUsbInit{0x04, 60};
inline constexpr OmniUsbCommand kOmniUsbServo{0x07, 7};
// From the device. Our guess: the text is printable, and where it stands.
inline constexpr OmniUsbCommand kOmniUsbFirmwareReply{0x0e, 32};
inline constexpr OmniUsbCommand kOmniUsbSerialReply{0x09, 97};

inline constexpr std::array<std::uint8_t, 7> kOmniUsbServoOn = {0x01, 0, 0, 0x80, 0, 0, 0};

// Returns the number of bytes of the frame. Returns 0, and writes nothing, if the payload is too
// long or `out` is too short.
std::size_t EncodeOmniUsbFrame(std::uint8_t command, std::span<const std::uint8_t> payload,
                               std::span<std::uint8_t> out) noexcept;

struct OmniUsbFrame {
  std::uint8_t command = 0;
  std::span<const std::uint8_t> payload{};  // from the parser: valid until its next call
};

// The framing of the Touch's serial line over USB: A5 5A, a command, the length of the payload, the
// payload. There is no checksum.
//
// Source: one published trace of one device; verification level none. The trace has the queries and
// the start sequence below. The frames with positions and forces are not public, neither their
// command bytes nor their contents.
//
// Threads: one. Real-time: no allocation, bounded. Errors: none; bytes outside of frames are
// counted.
//
// Finds frames in a stream of bytes that is cut anywhere. The result depends on the bytes and not
// on the cuts.
//
// Without a checksum a damaged payload passes, and a damaged length swallows the following frames,
// at most 255 bytes.
class OmniUsbParser {
 public:
  // Returns the next whole frame. Cuts off the bytes that it takes from `bytes`. Returns none if it
  // has taken all bytes.
  std::optional<OmniUsbFrame> Next(std::span<const std::uint8_t>& bytes) noexcept;

  // Drops an unfinished frame. Counts stay.
  void Reset() noexcept;

  // The number of bytes outside of frames, and the number of unbroken runs of such bytes.
  std::uint64_t corrupt_bytes() const { return corrupt_bytes_; }
  std::uint64_t corrupt_runs() const { return corrupt_runs_; }

 private:
  bool HeaderFits() const noexcept;
  void Drop(std::size_t bytes) noexcept;

  std::array<std::uint8_t, kOmniUsbMaxFrameBytes> held_{};
  std::size_t held_bytes_ = 0;
  bool frame_is_out_ = false;  // held_ is the frame that was returned last
  bool in_run_ = false;
  std::uint64_t corrupt_bytes_ = 0;
  std::uint64_t corrupt_runs_ = 0;
};

}  // namespace palpate
