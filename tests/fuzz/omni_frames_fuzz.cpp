// Any bytes as a frame of the FireWire Omni, through its kinematics, and any force back.
#include "server/device/omni/firewire_frames.h"
#include "server/device/omni/kinematics.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  fuzz::Input input({data, size});
  const auto frame = input.TakeBytes(kOmniStateBytes);
  const auto state = DecodeOmniState(frame);
  FUZZ_CHECK(frame.size() == kOmniStateBytes || !state);
  if (state) {
    for (const double angle : state->gimbal_rad) FUZZ_CHECK(std::abs(angle) <= 2.75);
    const OmniJoints joints = OmniJointsFromCounts(state->encoders);
    const Vec3 p = OmniPosition(joints);
    FUZZ_CHECK(p.allFinite() && p.norm() < 600.0);
    FUZZ_CHECK(OmniTorques_n_mm(joints, Vec3(3.3, -3.3, 3.3)).allFinite());
  }
  const Vec3 any = input.TakeVec3();
  OmniJoints joints;
  if (OmniJointsAt(any, joints)) FUZZ_CHECK((OmniPosition(joints) - any).norm() < 1e-6);
  const auto bytes =
      EncodeOmniForce({.motors = {input.Take<int>(), input.Take<int>(), input.Take<int>()},
                       .force_enabled = size % 2 == 0,
                       .dock_light = input.Take<std::uint8_t>()});
  // 12 bits each.
  for (std::size_t n = 0; n < 3; ++n) FUZZ_CHECK(bytes[2 * n + 1] <= 0x0f);
  return 0;
}
