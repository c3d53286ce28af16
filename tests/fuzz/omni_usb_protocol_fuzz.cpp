// A Touch on USB, with named frames, that sends anything: readings are finite, and what
// it is sent is a whole frame, enabled only where there may be a force.
#include <algorithm>

#include "server/device/omni/omni_usb_protocol.h"
#include "tests/fuzz/protocol_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  constexpr std::uint8_t kState = 0x10, kForce = 0x11;
  OmniUsbProtocol protocol({.frames = OmniUsbFrames::kFramedFirewire,
                            .state_command = kState,
                            .force_command = kForce,
                            .init_payload = {{}},
                            .motor_counts_per_n_mm = std::array<double, 3>{3.0, -3.0, 3.0}});
  fuzz::PlayScript(protocol, {data, size},
                   [&](std::span<const std::uint8_t> bytes, const Vec3& force_D_n, bool may_push) {
                     OmniUsbParser parser;
                     const auto frame = parser.Next(bytes);
                     FUZZ_CHECK(frame && frame->command == kForce && bytes.empty());
                     FUZZ_CHECK(frame->payload.size() == kOmniForceBytes);
                     const bool enabled = (frame->payload[6] & 8u) != 0;
                     FUZZ_CHECK(!enabled || (may_push && force_D_n.allFinite()));
                     const auto zero = EncodeOmniForce({});
                     if (!enabled) FUZZ_CHECK(std::ranges::equal(frame->payload, zero));
                   });
  return 0;
}
