// The original Phantom Omni, on FireWire.
//
// The device talks on one isochronous channel and listens on another. Registers tell it which, and
// start and stop its packets. How often it sends is not public: the packets' times tell it, and the
// kernel then tells of packets a thousand times a second. Without the force of a motor count, which
// is not public either, its motors stay off.
//
// What the device does with its last force when packets end, because palpated was killed, nobody
// knows: assume that it keeps it.
//
// Frame M: as in kinematics.h. Threads, errors: as StreamBus.
// Source: three public drivers that ran on hardware; the facts are from their code. Where they
// differ, the vendor's order counts. Verification level: none; we have not seen a device.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/device/omni/omni_arm.h"
#include "server/device/stream/streamed_device.h"

namespace palpate {

inline constexpr std::uint32_t kOmniVendor = 0x000b99;  // the upper 24 bits of its GUID

// The serial number of a Phantom Omni, as the vendor's tools print it, in the lower word of its
// GUID.
//
// From the highest bit: 6 bits that are 100000, year (3), month (4), day (5), a kind (3), number
// (10), one bit without a meaning. Printed: year, month, day and kind as 1, 2, 2 and 1 digits, then
// the number with 5.
// Source: two public drivers and a public test program, and the GUIDs and serial numbers of two
// devices, which agree.
std::string OmniSerialOf(std::uint64_t guid);

inline constexpr VerificationLevel kOmniFirewireVerification = VerificationLevel::kNone;

struct OmniFirewireOptions {
  std::string serial{};  // as OmniSerialOf; "": the only device
  // As OmniArm's.
  std::optional<OmniArm::Gains> motor_counts_per_n_mm{};
};

// Without motors its greatest force is 0.
DeviceDescription OmniFirewireSpec(bool has_motors);

// What keeps the machine from any such device, for people; "": nothing, or it is unplugged.
std::string OmniFirewireProblem();

class OmniFirewireBus final : public StreamBus {
 public:
  // Throws Error (kInvalidArgument) for gains that cannot be.
  explicit OmniFirewireBus(const OmniFirewireOptions& options);

  const DeviceDescription& spec() const override { return spec_; }
  std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) override;
  std::string calibration_hint() const override;
  void RequestCalibration() override { arm_.RequestCalibration(); }

 private:
  const std::string serial_;
  const DeviceDescription spec_;
  OmniArm arm_;
};

}  // namespace palpate
