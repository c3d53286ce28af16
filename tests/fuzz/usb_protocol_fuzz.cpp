// A device on USB that sends anything, and any forces to it: readings are finite, and what it is
// sent is a whole frame, without a force where there may be none. Which device u8 (a Falcon, or a
// Touch with named frames), then steps between SetUp and TearDown:
//
//   step: a byte; even: a transfer of twice as many bytes, which follow;
//         odd: a force, 3 doubles; bit 1: forces are on
#include <algorithm>
#include <array>
#include <cmath>

#include "server/device/falcon/falcon_protocol.h"
#include "server/device/falcon/kinematics.h"
#include "server/device/omni/omni_usb_protocol.h"
#include "tests/fuzz/fuzz_input.h"

namespace palpate::fuzz {
namespace {

void CheckReading(const DeviceState& state, const DeviceSpec& spec) {
  FUZZ_CHECK(state.p_DHip_mm.allFinite());
  FUZZ_CHECK(state.p_DHip_mm.norm() < 1000.0);
  FUZZ_CHECK(std::abs(state.R_DS.norm() - 1.0) < 1e-6);
  FUZZ_CHECK((state.buttons >> spec.button_count) == 0);
}

bool IsSame(const DeviceState& a, const DeviceState& b) {
  return a.p_DHip_mm == b.p_DHip_mm && a.R_DS.coeffs() == b.R_DS.coeffs() &&
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
      const UsbReceived received = protocol.Receive(transfer, state);
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
      const std::size_t size = protocol.Encode(force_D_n, forces_on, out);
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

void PlayTouch(Input input) {
  constexpr std::uint8_t kState = 0x10, kForce = 0x11;
  OmniUsbProtocol protocol({.frames = OmniUsbFrames::kFramedFirewire,
                            .state_command = kState,
                            .force_command = kForce,
                            .init_payload = {{}},
                            .motor_counts_per_n_mm = std::array<double, 3>{3.0, -3.0, 3.0}});
  PlayScript(protocol, input,
             [](std::span<const std::uint8_t> bytes, const Vec3& force_D_n, bool may_push) {
               OmniUsbParser parser;
               const auto frame = parser.Next(bytes);
               FUZZ_CHECK(frame && frame->command == kForce && bytes.empty());
               FUZZ_CHECK(frame->payload.size() == kOmniForceBytes);
               const bool enabled = (frame->payload[6] & 8u) != 0;
               FUZZ_CHECK(!enabled || (may_push && force_D_n.allFinite()));
               const auto zero = EncodeOmniForce({});
               if (!enabled) FUZZ_CHECK(std::ranges::equal(frame->payload, zero));
             });
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(usb_protocol_fuzz) {
  palpate::fuzz::Input input({data, size});
  const bool is_touch = input.Take<std::uint8_t>() % 2 != 0;
  is_touch ? palpate::fuzz::PlayTouch(input) : palpate::fuzz::PlayFalcon(input);
  return 0;
}
