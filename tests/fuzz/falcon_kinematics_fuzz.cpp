// Any angles, positions and torques, also such as are no numbers: results are finite,
// or there are none.
#include "server/device/falcon/kinematics.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  fuzz::Input input({data, size});
  // As the device has them, and as nobody has them.
  std::array<std::int16_t, 3> counts{};
  for (auto& count : counts) count = input.Take<std::int16_t>();
  const Vec3 counted_rad = FalconAnglesFromCounts(counts);
  FUZZ_CHECK(FalconCountsFromAngles(counted_rad) == counts);
  const Vec3 any = input.TakeVec3();
  for (const Vec3& angles_rad : {counted_rad, any}) {
    Vec3 p, back;
    if (!FalconPositionAt(angles_rad, p)) continue;
    FUZZ_CHECK(p.allFinite() && p.norm() < 400.0);
    FUZZ_CHECK(FalconAnglesAt(p, back));
    FUZZ_CHECK((back - angles_rad).norm() < 1e-5);
    Mat3 jacobian;
    if (FalconJacobianAt(p, angles_rad, jacobian)) FUZZ_CHECK(jacobian.allFinite());
  }
  Vec3 angles_rad;
  Mat3 jacobian;
  if (FalconAnglesAt(any, angles_rad)) FUZZ_CHECK(angles_rad.allFinite());
  if (FalconJacobianAt(any, counted_rad, jacobian)) FUZZ_CHECK(jacobian.allFinite());
  for (const std::int16_t motor : FalconMotorsFromTorques(any)) {
    FUZZ_CHECK(motor >= -kFalconMotorLimit && motor <= kFalconMotorLimit);
  }
  return 0;
}
