// The Phantom Omni / Geomagic Touch on USB.
//
// How its serial line is framed, and how it is asked who it is, comes from one
// published trace (usb_frames.h). Its servo frames over USB are not public. So there
// are two modes:
//
// - kNone: says who the device is, and that there is no more. Nothing is decoded and
//   nothing sent after the queries.
// - kFramedFirewire: an ASSUMPTION that the operator makes by naming it, with command
//   bytes learned from a capture: the payloads are the FireWire model's frames
//   (firewire_frames.h), framed. No source says so.
//
// Verification level of all of it: none. We have not seen a device.
//
// The place of rest: the encoders count from where they were switched on. Where they are
// while the stylus rests in its dock, the same for kOmniRestReadings docked readings,
// is 0 for the kinematics; every docking says it anew. Before the first one of a
// connection, and after each RequestCalibration, positions have no meaning and no force
// is sent.
// Frame D: that of kinematics.h, without an offset. The workspace, that of the data
// sheet about D's origin, is all within reach.
//
// Threads, real-time: as UsbProtocol; RequestCalibration on any thread.
// Errors: UsbError from SetUp; Error from the constructor.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "server/device/omni/firewire_frames.h"
#include "server/device/omni/kinematics.h"
#include "server/device/omni/usb_frames.h"
#include "server/device/usb/usb_protocol.h"

namespace palpate {

// What we have seen of this device on hardware. Raised one step at a time, with the
// evidence that deploy/guides/devices.md asks for.
inline constexpr VerificationLevel kOmniUsbVerification = VerificationLevel::kNone;

enum class OmniUsbFrames : std::uint8_t { kNone, kFramedFirewire };

inline constexpr int kOmniRestReadings = 50;
// With 10 the motors would be at their greatest from 1 N at the far end of the arm on.
inline constexpr double kOmniMaxMotorGain = 10.0;

struct OmniUsbOptions {
  std::string port{};  // as in UsbMatch
  OmniUsbFrames frames = OmniUsbFrames::kNone;
  // All that follows is for kFramedFirewire, and is learned from a capture; the
  // commands must be given.
  std::optional<std::uint8_t> state_command{};
  std::optional<std::uint8_t> force_command{};
  // What the device gets before its servo is switched on; must be given. The trace that
  // we know of does not give the bytes, and what other bytes do is not known.
  std::optional<std::array<std::uint8_t, kOmniUsbInit.payload_bytes>> init_payload{};
  // Motor counts per N mm of torque at the base, shoulder and elbow, kOmniMaxMotorGain at
  // most; negative where a motor's count turns its joint back. Neither sizes nor signs
  // are public: without them the motors stay at zero, and off.
  std::optional<std::array<double, 3>> motor_counts_per_n_mm{};
};

// Where the device is, and its forces; before there is one.
DeviceSpec OmniUsbSpec();

// Ids of all known ones, for finding; and what is wrong with one ("": nothing).
const std::vector<UsbMatch::Ids>& OmniUsbIds();
std::string OmniUsbProblem(const UsbMatch::Ids& ids);

class OmniUsbProtocol final : public UsbProtocol {
 public:
  // Throws Error (kInvalidArgument) for options that do not fit.
  explicit OmniUsbProtocol(const OmniUsbOptions& options);

  const DeviceSpec& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }

  // In kNone it always ends with kUnsuitable, whose message has the device's identity
  // and what to do.
  std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) override;
  UsbReceived Receive(std::span<const std::uint8_t> bytes, DeviceState& state) noexcept override;
  // In kNone nothing: 0 bytes.
  std::size_t Encode(const Vec3& force_D_n, bool forces_on,
                     std::span<std::uint8_t, kMaxFrameBytes> out) noexcept override;
  bool is_request_response() const override { return false; }
  void TearDown(UsbLink& link) noexcept override;
  const char* calibration_hint() const noexcept override;
  bool RequestCalibration() noexcept override;

 private:
  // As of a connection that begins.
  void Forget() noexcept;
  void StartServo(UsbLink& link);
  // Keeps what later readings and forces need.
  void Take(const OmniState& reading, UsbReceived& received) noexcept;
  void Calibrate(const OmniState& reading) noexcept;
  DeviceState StateOf(const OmniState& reading) const noexcept;
  // None: no force can be given.
  std::optional<std::array<int, 3>> MotorCounts(const Vec3& force_D_n) const noexcept;

  OmniUsbOptions options_;
  DeviceSpec spec_;
  UsbMatch match_;

  OmniUsbParser parser_;
  OmniJoints joints_;                   // of the last reading
  std::array<std::int16_t, 3> zero_{};  // encoders at the place of rest
  bool calibrated_ = false;
  std::array<std::int16_t, 3> docked_at_{};  // encoders of the docked readings so far
  int rest_readings_ = 0;                    // docked, with the same encoders
  std::atomic<bool> calibration_wanted_{false};
  std::optional<std::uint32_t> counter_;  // of the last reading
  bool servo_started_ = false;
};

}  // namespace palpate
