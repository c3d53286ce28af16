// The Phantom Omni / Geomagic Touch on USB.
//
// The framing of the serial line and the identity queries come from one published trace
// (usb_frames.h). The servo frames over USB are not public. So there are two modes:
//
// - kNone: reports the device's identity and that it cannot be driven. Decodes nothing, and sends
//   nothing after the queries.
// - kFramedFirewire: assumes that the payloads are the FireWire model's frames (firewire_frames.h).
//   No source says so. The operator makes this ASSUMPTION by choosing the mode, with command bytes
//   learned from a capture.
//
// Verification level of all of it: none. We have not seen a device.
//
// The place of rest: the encoders count from their positions at power-on. The zero of the
// kinematics is the encoders' position while the stylus rests in its dock, after kOmniRestReadings
// equal docked readings. Every docking sets the zero anew. Before the first docking of a
// connection, and after each RequestCalibration, positions have no meaning and no force is sent.
// Frame D: as in kinematics.h, without an offset. The workspace is the data sheet's, about D's
// origin. All of it is within reach.
//
// Threads, real-time: as UsbProtocol. RequestCalibration on any thread.
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

// What we have seen of this device on hardware. Raise it one step at a time, with the evidence that
// deploy/guides/devices.md asks for.
inline constexpr VerificationLevel kOmniUsbVerification = VerificationLevel::kNone;

enum class OmniUsbFrames : std::uint8_t { kNone, kFramedFirewire };

inline constexpr int kOmniRestReadings = 50;
// With 10, the motors saturate at 1 N with the arm stretched out.
inline constexpr double kOmniMaxMotorGain = 10.0;

struct OmniUsbOptions {
  std::string port{};  // as in UsbMatch
  OmniUsbFrames frames = OmniUsbFrames::kNone;
  // The members below are for kFramedFirewire and are learned from a capture. The commands are
  // required.
  std::optional<std::uint8_t> state_command{};
  std::optional<std::uint8_t> force_command{};
  // The payload of the frame before the servo is switched on; required. The known trace does not
  // give the bytes, and the effect of other bytes is unknown.
  std::optional<std::array<std::uint8_t, kOmniUsbInit.payload_bytes>> init_payload{};
  // Motor counts per N mm of torque at the base, shoulder and elbow, at most kOmniMaxMotorGain.
  // Negative if a positive count turns the joint back. Neither sizes nor signs are public. Without
  // this member the motors stay off, with zero force.
  std::optional<std::array<double, 3>> motor_counts_per_n_mm{};
};

// The spec of the device, also without a device.
DeviceSpec OmniUsbSpec();

// OmniUsbIds: the ids of all known devices. OmniUsbProblem: why a device cannot be driven ("": it
// can).
const std::vector<UsbMatch::Ids>& OmniUsbIds();
std::string OmniUsbProblem(const UsbMatch::Ids& ids);

class OmniUsbProtocol final : public UsbProtocol {
 public:
  // Throws Error (kInvalidArgument) if the options do not fit together.
  explicit OmniUsbProtocol(const OmniUsbOptions& options);

  const DeviceSpec& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }

  // With kNone always throws kUnsuitable. The message has the device's identity and what to do.
  std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) override;
  UsbReceived Receive(std::span<const std::uint8_t> bytes, DeviceState& state) noexcept override;
  // With kNone returns 0: nothing to send.
  std::size_t Encode(const Vec3& force_D_n, bool forces_on,
                     std::span<std::uint8_t, kMaxFrameBytes> out) noexcept override;
  bool is_request_response() const override { return false; }
  void TearDown(UsbLink& link) noexcept override;
  const char* calibration_hint() const noexcept override;
  bool RequestCalibration() noexcept override;

 private:
  // Resets the state for a new connection.
  void Forget() noexcept;
  void StartServo(UsbLink& link);
  // Keeps the values that later readings and forces need.
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
