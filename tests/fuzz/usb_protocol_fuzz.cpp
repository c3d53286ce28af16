// A device that sends anything, and any forces to it: readings are finite, and what it is sent is a
// whole frame, without a force where there may be none. Which device u8 (a Falcon on USB, or the
// arm of an Omni), then steps:
//
//   step: a byte; even: a transfer of twice as many bytes, which follow (Omni: a reading);
//         odd: a force, 3 doubles; bit 1: forces are on
#include <algorithm>
#include <array>
#include <cmath>

#include "server/device/falcon/falcon_protocol.h"
#include "server/device/falcon/kinematics.h"
#include "server/device/omni/omni_arm.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

void CheckReading(const DeviceState& state, const DeviceDescription& spec) {
  FUZZ_CHECK(state.p_MHip_mm.allFinite());
  FUZZ_CHECK(state.p_MHip_mm.norm() < 1000.0);
  FUZZ_CHECK(std::abs(state.R_MS.norm() - 1.0) < 1e-6);
  FUZZ_CHECK((state.buttons >> spec.button_count) == 0);
}

bool IsSame(const DeviceState& a, const DeviceState& b) {
  return a.p_MHip_mm == b.p_MHip_mm && a.R_MS.coeffs() == b.R_MS.coeffs() &&
         a.buttons == b.buttons && a.docked == b.docked && a.calibrated == b.calibrated;
}

// check_frame(bytes, force_D_n, may_push) checks a frame to the device. may_push: forces are on and
// the last reading was calibrated.
template <typename CheckFrame>
void PlayScript(UsbProtocol& protocol, Input input, CheckFrame check_frame) {
  DeviceState state{.calibrated = false};  // before the first reading
  while (!input.empty()) {
    const auto step = input.Take<std::uint8_t>();
    if (step % 2 == 0) {
      const auto transfer = input.TakeBytes(2u * step);
      const DeviceState before = state;
      const StreamReceived received = protocol.Receive(transfer, state);
      FUZZ_CHECK(received.has_reading == (received.readings > 0));
      FUZZ_CHECK(received.readings <= transfer.size());
      FUZZ_CHECK(received.corrupt_frames <= transfer.size() + 1);
      if (received.has_reading) {
        CheckReading(state, protocol.spec());
      } else {
        FUZZ_CHECK(IsSame(state, before));
      }
    } else {
      const Vec3 force_D_n = input.TakeVec3();
      const bool forces_on = (step & 2) != 0;
      std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
      const std::size_t size = protocol.Encode({{force_D_n}, forces_on}, out);
      FUZZ_CHECK(size <= out.size());
      check_frame(std::span<const std::uint8_t>(out).first(size), force_D_n,
                  forces_on && state.calibrated);
    }
  }
}

void PlayFalcon(Input input) {
  FalconProtocol protocol({});
  PlayScript(protocol, input,
             [](std::span<const std::uint8_t> frame, const Vec3& force_D_n, bool may_push) {
               const auto command = DecodeFalconCommand(frame);
               FUZZ_CHECK(command && command->homing);
               const int limit = may_push && force_D_n.allFinite() ? kFalconMotorLimit : 0;
               for (const int motor : command->motors) FUZZ_CHECK(std::abs(motor) <= limit);
             });
}

void PlayOmni(Input input) {
  DeviceDescription spec;
  spec.button_count = 2;
  OmniArm arm(OmniArm::Gains{3.0, -3.0, 3.0});
  DeviceState state{.calibrated = false};
  while (!input.empty()) {
    const auto step = input.Take<std::uint8_t>();
    if (step % 2 == 0) {
      const auto reading = DecodeOmniState(input.TakeBytes(2u * step));
      if (reading && arm.Take(*reading, state)) CheckReading(state, spec);
      continue;
    }
    const Vec3 force_D_n = input.TakeVec3();
    const OmniForce force = arm.ForceOf(force_D_n, (step & 2) != 0);
    const bool may_push = (step & 2) != 0 && state.calibrated && force_D_n.allFinite();
    FUZZ_CHECK(!force.force_enabled || may_push);
    const int limit = force.force_enabled ? kOmniMotorRange : 0;
    for (const int motor : force.motors) FUZZ_CHECK(std::abs(motor) <= limit);
  }
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(usb_protocol_fuzz) {
  palpate::fuzz::Input input({data, size});
  const bool is_omni = input.Take<std::uint8_t>() % 2 != 0;
  is_omni ? palpate::fuzz::PlayOmni(input) : palpate::fuzz::PlayFalcon(input);
  return 0;
}
