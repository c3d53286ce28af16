// The Touch on USB, all of it: protocol, transport and thread against an emulated
// device, whose servo frames are our assumption too. It proves nothing of a real one.
#include <gtest/gtest.h>

#include <cstdio>
#include <functional>
#include <memory>

#include "server/device/omni/omni_usb_protocol.h"
#include "server/device/usb/usb_device.h"
#include "tests/support/omni_frames.h"
#include "tests/support/patience.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {
namespace {

class OmniUsbDeviceTest : public ::testing::Test {
 protected:
  static constexpr double kCountsPerNmm = 2.0;

  void Start() {
    OmniUsbOptions options = NamedOmniUsbOptions();
    options.motor_counts_per_n_mm = {kCountsPerNmm, kCountsPerNmm, kCountsPerNmm};
    bus_.Plug("1-2", touch_);
    device_ = std::make_unique<UsbDevice>(std::make_unique<OmniUsbProtocol>(options), 0);
    device_->Start();
  }
  // Where the arm rests, or in the hand.
  void Hold(bool docked) {
    if (docked == docked_) return;
    docked_ = docked;
    const Vec3 place = docked ? Vec3(0, -110, -35) : kPlace;
    touch_.SetPath([place](double) { return place; });
    touch_.SetDocked(docked);
  }
  // Ticks as the servo does, and docks the stylus whenever its position has no meaning: after the
  // start, and where a halt of this machine made it look silent.
  bool Serve(const Vec3& force_D_n, const std::function<bool()>& is_so) {
    return Eventually([&] {
      const DeviceStatus status = device_->Read(state_);
      Hold(!state_.calibrated);
      if (status == DeviceStatus::kOk && is_so()) return true;
      // As the safety stage does after a halt of this machine.
      device_->Write(status == DeviceStatus::kStale ? Vec3::Zero() : force_D_n, 0.001);
      return false;
    });
  }

  const Vec3 kPlace{30, -20, 10};
  TouchEmulator touch_;
  UsbTestbed bus_;
  std::unique_ptr<UsbDevice> device_;
  DeviceState state_;

 private:
  bool docked_ = false;
};

TEST_F(OmniUsbDeviceTest, DockedThenInTheHandItStreamsAndGetsForces) {
  touch_.SetButtons(true, false);
  Start();
  const auto is_there = [&] {
    return !state_.docked && state_.calibrated && (state_.p_DHip_mm - kPlace).norm() < 0.1;
  };
  EXPECT_TRUE(Serve(Vec3::Zero(), is_there));
  EXPECT_EQ(device_->health().identity, "serial EMULATED0001, firmware emulated 1.0");
  EXPECT_EQ(state_.buttons, 1u);

  const Vec3 force(0.5, -1.0, 0.7);
  std::size_t before = touch_.Forces().size();
  EXPECT_TRUE(Serve(force, [&] { return touch_.Forces().size() > before + 50; }));
  EXPECT_TRUE(touch_.Forces().back().IsZero());  // nobody has let the motors on
  EXPECT_FALSE(touch_.Forces().back().enabled);
  device_->SetMotors(true);
  OmniJoints joints;
  EXPECT_TRUE(OmniJointsAt(kPlace, joints));
  const Vec3 counts = kCountsPerNmm * OmniTorques_n_mm(joints, force);
  const auto is_felt = [&] {
    const TouchForce felt = touch_.Forces().back();
    const Vec3 motors(felt.motors[0], felt.motors[1], felt.motors[2]);
    return is_there() && felt.enabled && (motors - counts).cwiseAbs().maxCoeff() < 2.0;
  };
  EXPECT_TRUE(Serve(force, is_felt));

  device_->Stop();
  EXPECT_TRUE(touch_.Forces().back().IsZero());
  EXPECT_FALSE(touch_.Forces().back().enabled);
  EXPECT_FALSE(touch_.is_streaming());
  EXPECT_EQ(touch_.Commands().back(), 0x07);
  EXPECT_EQ(touch_.garbage_bytes(), 0u);
}

TEST_F(OmniUsbDeviceTest, LostAndDamagedFramesAreCountedAndSurvived) {
  touch_.SetLossEvery(10);
  touch_.SetBadFrameEvery(7);
  Start();
  ASSERT_TRUE(Serve(Vec3::Zero(), [&] { return device_->health().readings > 500; }));
  const DeviceHealth health = device_->health();
  const double lost = static_cast<double>(health.lost_readings);
  const double all = static_cast<double>(health.readings) + lost;
  // The emulated device also drops what is not fetched in time.
  EXPECT_GT(lost / all, 1.0 / 10 + 1.0 / 7 - 1.0 / 70 - 0.02);
}

// A device that waits for its forces gets one for each state.
using OmniUsbTimes = OmniUsbDeviceTest;
TEST_F(OmniUsbTimes, EachStateIsAnsweredByAForce) {
  touch_.SetWaitsForForces(true);
  Start();
  ASSERT_TRUE(Serve(Vec3::Zero(), [&] { return device_->health().readings > 100; }));
  const DeviceHealth before = device_->health();
  ASSERT_TRUE(Serve(Vec3::Zero(), [&] { return device_->health().readings > 2000; }));
  const DeviceHealth after = device_->health();
  const auto forces = static_cast<double>(after.forces_written - before.forces_written);
  const double share = forces / static_cast<double>(after.readings - before.readings);
  std::printf("forces for each state %.3f\n", share);
  EXPECT_GT(share, 0.9);
  EXPECT_LT(share, 1.1);
}

}  // namespace
}  // namespace palpate::test
