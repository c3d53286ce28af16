// A hand that holds an emulated Novint Falcon: its encoders at a place, and what force the motors'
// counts are on the hand. By the driver's kinematics, which falcon_test.cpp judges.
//
// Frame M: mm, x right, y up, z towards the user; N.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

#include "server/device/falcon/frames.h"
#include "server/device/falcon/kinematics.h"
#include "tests/support/emulated.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {

class FalconStand {
 public:
  static std::array<std::int16_t, 3> At(const Vec3& p_mm) {
    return FalconCountsFromAngles(AnglesAt(p_mm));
  }
  // The force on a hand at this place.
  static Vec3 ForceOf(const FalconCommand& command, const Vec3& p_mm) {
    Mat3 jacobian;
    EXPECT_TRUE(FalconJacobianAt(p_mm, AnglesAt(p_mm), jacobian));
    const Vec3 counts(command.motors[0], command.motors[1], command.motors[2]);
    return jacobian.transpose().inverse() * (counts / kFalconMotorCountsPerNmm);
  }
  static bool IsZero(const FalconCommand& command) {
    return command.motors == decltype(command.motors){};
  }

 private:
  static Vec3 AnglesAt(const Vec3& p_mm) {
    Vec3 angles_rad;
    EXPECT_TRUE(FalconAnglesAt(p_mm, angles_rad)) << p_mm.transpose();
    return angles_rad;
  }
};

// A file of bytes that an emulated Falcon takes for its firmware.
class FalconFirmware {
 public:
  FalconFirmware() {
    for (std::size_t n = 0; n < bytes_.size(); ++n) bytes_[n] = static_cast<std::uint8_t>(n * 7);
    std::ofstream(file_, std::ios::binary) << std::string(bytes_.begin(), bytes_.end());
  }
  const Bytes& bytes() const { return bytes_; }
  const std::filesystem::path& file() const { return file_; }

 private:
  TemporaryFolder folder_{};
  std::filesystem::path file_ = folder_.path() / "firmware.bin";
  Bytes bytes_ = Bytes(5000);
};

}  // namespace palpate::test
