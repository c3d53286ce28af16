// The Novint Falcon on USB (0403:cb48).
//
// It has no firmware when its power comes on. Novint's is not ours to give: the operator
// names a file. Its encoders count from where they were then; they are right once the
// grip was pulled all the way out and pushed all the way in (homing). Until then, and
// when its angles are none that the arms can have, readings are not calibrated and
// forces are off. It does not dock and its grip does not turn.
//
// Lights: red until homed, blue without forces, green with them.
// Threads and real-time: as UsbProtocol. Ownership: none of the link.
// Source: frames.h, kinematics.h and bring_up.h name theirs. Verification level: none;
// we have not seen a device.
#pragma once

#include <string>

#include "server/device/falcon/frames.h"
#include "server/device/usb/usb_protocol.h"

namespace palpate {

struct FalconOptions {
  std::string port{};           // as UsbMatch's
  std::string firmware_file{};  // "": the Falcon has been given its firmware already
};

class FalconProtocol final : public UsbProtocol {
 public:
  explicit FalconProtocol(const FalconOptions& options);

  const DeviceSpec& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }
  std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) override;
  UsbReceived Receive(std::span<const std::uint8_t> bytes, DeviceState& state) noexcept override;
  std::size_t Encode(const Vec3& force_D_n, bool forces_on,
                     std::span<std::uint8_t, kMaxFrameBytes> out) noexcept override;
  bool is_request_response() const override { return true; }
  void TearDown(UsbLink& link) noexcept override;
  const char* calibration_hint() const noexcept override;

 private:
  void Understand(const FalconReport& report, DeviceState& state) noexcept;

  const DeviceSpec spec_;
  const UsbMatch match_;
  const std::string firmware_file_;

  FalconFrameFinder finder_{};
  // Of the newest reading.
  bool calibrated_ = false;
  Vec3 p_D_mm_ = Vec3::Zero();  // the last that had a meaning
  Vec3 angles_rad_ = Vec3::Zero();
};

}  // namespace palpate
