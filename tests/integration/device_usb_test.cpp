// A real daemon with an emulated Touch on USB: finding, setting up, streaming, letting
// go. The emulated servo frames are an assumption (tests/support/touch_emulator.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/integration/device_rig.h"
#include "tests/support/excuse.h"

namespace palpate::test {
namespace {

using Kind = UsbEvent::Kind;

// Of the device's states and the daemon's answers so far.
struct Counts {
  double sent = 0.0, brought = 0.0, readings = 0.0, lost = 0.0, forces = 0.0;
};

Counts CountsOf(DeviceRig& rig, const TouchEmulator& touch) {
  std::uint64_t sent = 0;
  v1::DeviceHealth health;
  // At one time: an answer that took long tells of another than the bus does.
  EXPECT_TRUE(Eventually([&] {
    sent = touch.states_sent();
    health = rig.Health();
    return touch.states_sent() <= sent + 20;
  }));
  return {.sent = static_cast<double>(sent),
          .brought = static_cast<double>(touch.InTransfers()),
          .readings = static_cast<double>(health.readings()),
          .lost = static_cast<double>(health.lost_readings()),
          .forces = static_cast<double>(health.forces_written())};
}

double MedianOf(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

TEST(UsbDevice, IsFoundClaimedAndIdentified) {
  TouchEmulator touch;
  DeviceRig rig;
  const std::int64_t began_ns = NowNs();
  ASSERT_TRUE(StartDocked(rig, touch));
  EXPECT_TRUE(rig.WaitForLog("omni-usb on USB port 1-2: connected, serial EMULATED0001, firmware"));
  const v1::GetDeviceResponse device = rig.Get();
  EXPECT_EQ(device.device().kind(), "omni-usb");
  EXPECT_EQ(device.device().verification_level(), v1::VERIFICATION_LEVEL_NONE);
  EXPECT_TRUE(Contains(device.health().identity(), "EMULATED0001"));
  EXPECT_EQ(device.health().problem(), "");
  EXPECT_TRUE(device.health().docked());
  EXPECT_EQ(device.health().connections(), 1u) << rig.ExcuseSince(began_ns);
  EXPECT_EQ(touch.CountOf(Kind::kDetachDriver), 1u) << rig.ExcuseSince(began_ns);
  EXPECT_EQ(touch.CountOf(Kind::kClaim), 2u) << rig.ExcuseSince(began_ns);
  EXPECT_TRUE(touch.is_streaming());
  EXPECT_TRUE(rig.WaitForLog("forces are off until `palpate device enable omni-usb`"));
}

TEST(UsbDevice, ExchangesStatesAndForcesNearOneKilohertz) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  // From the place of rest into the sphere and back once a second: whenever one begins to look.
  touch.SetDocked(false);
  touch.SetPath([](double time_s) {
    const Vec3 rest_mm(0.0, -110.0, -35.0), highest_mm(0.0, -17.0, 0.0);
    return Vec3(rest_mm + 0.5 * (1.0 - std::cos(2.0 * M_PI * time_s)) * (highest_mm - rest_mm));
  });
  const v1::DeviceHealth before = rig.Health();
  PoseCollector collector(rig.daemon());
  const Counts first = CountsOf(rig, touch);
  // By the half second: a machine that stops in one of them tells nothing of the device.
  // What the emulated bus is too slow to bring is no fault of the daemon.
  std::vector<double> sent, readings_share, forces_share;
  for (int half_second = 0; half_second < 10; ++half_second) {
    const Counts from = CountsOf(rig, touch);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    const Counts to = CountsOf(rig, touch);
    sent.push_back(to.sent - from.sent);
    readings_share.push_back((to.readings - from.readings) / (to.brought - from.brought));
    forces_share.push_back((to.forces - from.forces) / sent.back());
  }
  const Counts last = CountsOf(rig, touch);
  // None is lost unseen.
  EXPECT_NEAR(last.readings + last.lost - first.readings - first.lost, last.sent - first.sent, 50.0)
      << kBusyMachine;
  const v1::DeviceHealth after = rig.Health();
  std::printf("half a second: %.0f states, of those brought read %.3f, answered %.3f\n",
              MedianOf(sent), MedianOf(readings_share), MedianOf(forces_share));
  EXPECT_GT(MedianOf(sent), 450.0) << kBusyMachine;
  EXPECT_GT(MedianOf(readings_share), 0.95) << kBusyMachine;
  EXPECT_LT(MedianOf(forces_share), 1.2) << kBusyMachine;
  EXPECT_EQ(after.connections(), 1u) << rig.ExcuseSince(0);
  EXPECT_EQ(after.corrupt_frames(), before.corrupt_frames());
  // The servo saw the stylus go where it went.
  double lowest_mm = 0.0, highest_mm = -200.0;
  for (const v1::PoseSample& sample : collector.Stop()) {
    lowest_mm = std::min(lowest_mm, sample.hip_mm().y());
    highest_mm = std::max(highest_mm, sample.hip_mm().y());
  }
  EXPECT_NEAR(lowest_mm, -110.0, 1.0);
  EXPECT_NEAR(highest_mm, -17.0, 1.0);
}

// A device that waits for its forces gets one for each state, however slow the bus.
TEST(UsbDevice, EachStateIsAnsweredByAForce) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  Undock(touch);
  touch.SetWaitsForForces(true);
  const Counts from = CountsOf(rig, touch);
  ASSERT_TRUE(Eventually([&] { return CountsOf(rig, touch).sent > from.sent + 2000; }));
  const Counts to = CountsOf(rig, touch);
  const double sent = to.sent - from.sent;
  std::printf("of %.0f states answered %.3f\n", sent, (to.forces - from.forces) / sent);
  EXPECT_GT(to.readings - from.readings, 0.99 * sent - 1.0) << rig.ExcuseSince(0);
  EXPECT_GT(to.forces - from.forces, 0.9 * sent) << rig.ExcuseSince(0);
  EXPECT_LT(to.forces - from.forces, 1.1 * sent) << rig.ExcuseSince(0);
}

TEST(UsbDevice, ForcesAreOffUntilEnabledByName) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  Undock(touch);
  ASSERT_TRUE(TakesForces(touch, kForcesOfAnApproach + kForcesOfAPress));
  for (const std::string name : {"", "simulated", "falcon", "Omni-USB"}) {
    EXPECT_EQ(rig.Enable(name).error_code(), grpc::StatusCode::INVALID_ARGUMENT) << name;
  }
  EXPECT_TRUE(TakesForces(touch, kForcesOfAPress));
  const std::vector<TouchForce> forces = touch.Forces();
  for (const TouchForce& force : forces) ASSERT_TRUE(force.IsZero());
  EXPECT_EQ(rig.Forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_OPERATOR);

  ASSERT_TRUE(PressWithForces(rig, touch));
  EXPECT_TRUE(rig.WaitForLog("forces: on")) << rig.ExcuseSince(0);

  ASSERT_TRUE(rig.Disable().ok());
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_OFF));
  ASSERT_TRUE(TakesForces(touch, 200));  // ramped out
  const std::size_t before = CountForces(touch);
  EXPECT_TRUE(TakesForces(touch, 2 * kForcesOfAPress));
  EXPECT_EQ(CountForces(touch), before);
}

// What is felt comes back; that it was felt does not.
TEST(UsbDevice, AfterAKillForcesAreOffUntilEnabledAgain) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  ASSERT_TRUE(PressWithForces(rig, touch));
  ASSERT_TRUE(rig.SetStiffness(0.25).ok());
  ASSERT_TRUE(Eventually([&] { return rig.IsKept("stiffness_n_per_mm = 0.25"); }));
  rig.Kill();
  const std::size_t before = touch.Forces().size();
  Dock(touch);
  rig.Start(kTouchConfig);
  ASSERT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  ASSERT_TRUE(Eventually([&] { return rig.Health().calibrated(); }));
  EXPECT_TRUE(rig.WaitForLog("forces are off until `palpate device enable omni-usb`"));
  EXPECT_EQ(rig.Stiffness(), 0.25);
  Undock(touch);
  EXPECT_TRUE(TakesForces(touch, kForcesOfAnApproach + kForcesOfAPress));
  const std::vector<TouchForce> forces = touch.Forces();
  for (std::size_t n = before; n < forces.size(); ++n) ASSERT_TRUE(forces[n].IsZero());
  EXPECT_EQ(rig.Forces().state(), v1::FORCE_STATE_OFF);
  EXPECT_TRUE(PressWithForces(rig, touch));
}

TEST(UsbDevice, IsLetGoOfInOrder) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  ASSERT_TRUE(PressWithForces(rig, touch));
  EXPECT_TRUE(Contains(rig.End(), "ended after"));
  // Zero force, the servo off, then the interfaces and the kernel's driver.
  ASSERT_TRUE(Eventually([&] { return touch.CountOf(Kind::kClose) > 0; }));
  EXPECT_FALSE(touch.is_streaming());
  EXPECT_TRUE(touch.Forces().back().IsZero());
  EXPECT_FALSE(touch.Forces().back().enabled);
  const std::vector<UsbEvent> events = touch.Events();
  std::vector<Kind> last;
  for (auto event = events.rbegin(); event->kind != Kind::kOut; ++event) {
    last.insert(last.begin(), event->kind);
  }
  EXPECT_EQ(touch.Commands().back(), 0x07);
  EXPECT_EQ(std::count(last.begin(), last.end(), Kind::kRelease), 2);
  EXPECT_EQ(std::count(last.begin(), last.end(), Kind::kAttachDriver), 1);
  EXPECT_EQ(last.back(), Kind::kClose);
}

TEST(UsbDevice, MayBePluggedInLater) {
  TouchEmulator touch;
  DeviceRig rig;
  rig.Start(kTouchConfig);
  EXPECT_TRUE(rig.WaitForLog("omni-usb: not found"));
  EXPECT_EQ(rig.Health().connection(), DeviceRig::kAbsent);
  EXPECT_TRUE(Contains(rig.Health().problem(), "plug it in")) << rig.Health().problem();
  // There is nothing that forces could be enabled for.
  EXPECT_EQ(rig.Enable("omni-usb").error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  rig.bus().Plug("1-2", touch);
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  // Its encoders count from the holder, where it was not seen.
  EXPECT_FALSE(rig.Health().calibrated());
  EXPECT_TRUE(Contains(rig.Health().problem(), "holder")) << rig.Health().problem();
  touch.SetDocked(true);
  EXPECT_TRUE(Eventually([&] { return rig.Health().calibrated(); }));
  EXPECT_EQ(rig.Health().problem(), "");
}

TEST(UsbDevice, OfTwoOneMustBeNamed) {
  TouchEmulator first, second;
  DeviceRig rig;
  rig.bus().Plug("1-2", first);
  rig.bus().Plug("1-3", second);
  rig.Start(kTouchConfig);
  EXPECT_TRUE(rig.WaitForLog("several are plugged in, on USB ports 1-2, 1-3"));
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_EQ(rig.Health().connection(), DeviceRig::kAbsent);
  EXPECT_TRUE(Contains(rig.Health().problem(), "set [device] usb_port")) << rig.Health().problem();
  EXPECT_TRUE(first.Events().empty());
  EXPECT_TRUE(second.Events().empty());
}

TEST(UsbDevice, IsChosenByItsPort) {
  TouchEmulator first, second;
  DeviceRig rig;
  rig.bus().Plug("1-2", first);
  rig.bus().Plug("1-3", second);
  rig.Start(kTouchConfig + "usb_port = \"1-3\"\n");
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_TRUE(rig.WaitForLog("omni-usb on USB port 1-3: connected"));
  EXPECT_TRUE(first.Events().empty());
  EXPECT_TRUE(second.is_streaming());
}

TEST(UsbDevice, WithoutPermissionItSaysWhatToDo) {
  TouchEmulator touch;
  DeviceRig rig;
  rig.bus().Plug("1-2", touch, false);
  rig.Start(kTouchConfig, true);
  EXPECT_TRUE(rig.WaitForLog("omni-usb: found on USB port 1-2: "));
  const v1::DeviceHealth health = rig.Health();
  EXPECT_EQ(health.connection(), DeviceRig::kAbsent);
  EXPECT_TRUE(Contains(health.problem(), "udev")) << health.problem();
  EXPECT_TRUE(touch.Events().empty());
}

TEST(UsbDevice, HeldByAnotherProgramItSaysSo) {
  TouchEmulator touch;
  touch.SetFaults({.busy = true});
  DeviceRig rig;
  rig.bus().Plug("1-2", touch);
  rig.Start(kTouchConfig);
  EXPECT_TRUE(rig.WaitForLog("another program uses the device"));
  EXPECT_EQ(rig.Health().connection(), DeviceRig::kAbsent);
  touch.SetFaults({});
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
}

TEST(UsbDevice, WithoutNamedFramesItIsOnlyIdentified) {
  TouchEmulator touch;
  DeviceRig rig;
  rig.bus().Plug("1-2", touch);
  rig.Start("kind = \"omni-usb\"\n");
  EXPECT_TRUE(rig.WaitForLog("its servo frames over USB are not public"));
  EXPECT_NE(rig.Health().connection(), DeviceRig::kStreaming);
  EXPECT_TRUE(Contains(rig.Health().problem(), "EMULATED0001")) << rig.Health().problem();
  // Asked who it is, and nothing else.
  for (const std::uint8_t command : touch.Commands()) {
    EXPECT_TRUE(command == 0x0f || command == 0x0c) << int{command};
  }
  EXPECT_TRUE(touch.Forces().empty());
}

}  // namespace
}  // namespace palpate::test
