// A Falcon that sends anything: readings are finite and calibrated only when homed, and
// commands are whole frames, without a force where there may be none.
#include <algorithm>

#include "server/device/falcon/falcon_protocol.h"
#include "server/device/falcon/kinematics.h"
#include "tests/fuzz/protocol_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  FalconProtocol protocol({});
  fuzz::PlayScript(protocol, {data, size},
                   [&](std::span<const std::uint8_t> frame, const Vec3& force_D_n, bool may_push) {
                     const auto command = DecodeFalconCommand(frame);
                     FUZZ_CHECK(command && command->homing);
                     const int limit = may_push && force_D_n.allFinite() ? kFalconMotorLimit : 0;
                     for (const int motor : command->motors) {
                       FUZZ_CHECK(std::abs(motor) <= limit);
                     }
                   });
  return 0;
}
