// What an emulated USB device does wrong, and what a real daemon makes of it: its
// state, its log, and the forces that it sends.
#include <gtest/gtest.h>

#include "tests/integration/device_rig.h"
#include "tests/support/bare_loops.h"
#include "tests/support/excuse.h"

namespace palpate::test {
namespace {

const std::string kStayOff = "they stay off until `palpate device enable omni-usb`";

// A stylus that presses into the sphere with forces on.
testing::AssertionResult StartWithForces(DeviceRig& rig, TouchEmulator& touch) {
  if (!StartDocked(rig, touch)) return testing::AssertionFailure() << "it is not there";
  return PressWithForces(rig, touch);
}

// After the device was cut off: it is read again, and forces wait for the operator.
void ExpectRecovery(DeviceRig& rig, TouchEmulator& touch) {
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_TRUE(Contains(rig.Health().problem(), "has not been seen in its holder"))
      << rig.Health().problem();
  EXPECT_EQ(rig.Forces().state(), v1::FORCE_STATE_FAULT);
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_DEVICE);
  const std::size_t before = CountForces(touch);
  EXPECT_TRUE(TakesForces(touch, kForcesOfAPress));
  EXPECT_EQ(CountForces(touch), before);
  // Its position has a meaning again once it was in its holder.
  Dock(touch);
  EXPECT_TRUE(Eventually([&] { return rig.Health().calibrated(); }));
  EXPECT_EQ(rig.Health().problem(), "");
  EXPECT_TRUE(PressWithForces(rig, touch));
}

// After it was pulled out: whether it is really gone is more than the host can know.
bool TriedZeroForce(const TouchEmulator& touch) {
  const auto zero = EncodeOmniForce({});
  for (const UsbEvent& event : touch.Events()) {
    if (event.kind != UsbEvent::Kind::kLateOut || event.bytes.size() < zero.size()) continue;
    if (std::equal(zero.rbegin(), zero.rend(), event.bytes.rbegin())) return true;
  }
  return false;
}

// 1 kHz, but for the ticks that loops without work miss too, and one of a hundred.
void ExpectPace(DeviceRig& rig) {
  BareLoops bare_loops;
  const auto before = rig.Get().servo();
  std::this_thread::sleep_for(std::chrono::seconds(1));
  const auto after = rig.Get().servo();
  bare_loops.Stop();
  const auto ticks = static_cast<double>(after.ticks() - before.ticks());
  const auto missed = static_cast<double>(after.missed_ticks() - before.missed_ticks());
  // Ticks and missed ones count milliseconds: a loop that stands still has neither.
  EXPECT_GT(ticks + missed, 900.0) << kBusyMachine;
  EXPECT_LE(missed, 0.01 * (ticks + missed) + static_cast<double>(bare_loops.most()))
      << kBusyMachine;
}

// The loop goes on without the device, with no force.
void ExpectLoopInFault(DeviceRig& rig) {
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_TRUE(rig.WaitForLog("forces: fault (device) at tick"));
  EXPECT_TRUE(rig.WaitForLog(kStayOff));
  PoseCollector collector(rig.daemon());
  ExpectPace(rig);
  const auto& samples = collector.Stop();
  EXPECT_GT(samples.size(), 50u);
  for (const v1::PoseSample& sample : samples) {
    ASSERT_EQ(sample.mode(), v1::PROXY_MODE_FAULT);
    const v1::Vector3& force = sample.force_n();
    ASSERT_EQ(force.x() * force.x() + force.y() * force.y() + force.z() * force.z(), 0.0);
  }
}

TEST(UsbFaults, UnpluggedWhileItPressesAndPluggedInAgain) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForLog("omni-usb: unplugged; looking for it again"));
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kAbsent));
  ExpectLoopInFault(rig);
  EXPECT_TRUE(TriedZeroForce(touch));
  EXPECT_EQ(rig.Health().problem(), "unplugged; looking for it again");
  EXPECT_EQ(rig.Enable("omni-usb").error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  rig.bus().Plug("1-2", touch);
  ExpectRecovery(rig, touch);
  EXPECT_EQ(rig.Health().connections(), 2u);
}

TEST(UsbFaults, PluggedIntoAnotherPort) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForLog("unplugged"));
  rig.bus().Plug("1-4", touch);
  EXPECT_TRUE(rig.WaitForLog("omni-usb on USB port 1-4: connected"));
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
}

TEST(UsbFaults, SilentWhileItPresses) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetFaults({.silent = true});
  EXPECT_TRUE(rig.WaitForLog("omni-usb: no reading for 100 ms; connecting again"));
  ExpectLoopInFault(rig);
  // Zero force was sent before it was given up.
  EXPECT_TRUE(touch.Forces().back().IsZero());
  touch.SetFaults({});
  ExpectRecovery(rig, touch);
}

TEST(UsbFaults, AStallIsClearedAndTheStreamGoesOn) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  for (const std::uint8_t endpoint : {TouchEmulator::kDataIn, TouchEmulator::kDataOut}) {
    const std::uint64_t errors = rig.Health().transfer_errors();
    const std::size_t clears = touch.CountOf(UsbEvent::Kind::kClearHalt);
    touch.Stall(endpoint, false);
    EXPECT_TRUE(Eventually([&] { return rig.Health().transfer_errors() > errors; }));
    EXPECT_TRUE(Eventually([&] { return touch.CountOf(UsbEvent::Kind::kClearHalt) > clears; }));
    EXPECT_TRUE(WaitForForce(rig, touch)) << rig.ExcuseSince(0);
  }
  EXPECT_EQ(rig.Health().connections(), 1u) << rig.ExcuseSince(0);
  EXPECT_EQ(rig.Health().problem(), "");
  // Held for a moment or not, forces are there again without being enabled.
  EXPECT_TRUE(rig.WaitForAnyForce());
  // What mends itself is counted, and no line.
  EXPECT_FALSE(Contains(rig.End(), "stall"));
}

TEST(UsbFaults, AStallThatStaysEndsTheConnection) {
  for (const std::uint8_t endpoint : {TouchEmulator::kDataIn, TouchEmulator::kDataOut}) {
    TouchEmulator touch;
    DeviceRig rig;
    ASSERT_TRUE(StartWithForces(rig, touch));
    touch.Stall(endpoint, true);
    EXPECT_TRUE(rig.WaitForLog("the device refused")) << int{endpoint};
    ExpectLoopInFault(rig);
    EXPECT_TRUE(Contains(rig.Health().problem(), "refused")) << rig.Health().problem();
    touch.EndStalls();
    ExpectRecovery(rig, touch);
  }
}

TEST(UsbFaults, CutFramesAreDropped) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetFaults({.cut_in_to = 20});
  EXPECT_TRUE(rig.WaitForLog("omni-usb: no reading for 100 ms; connecting again"));
  ExpectLoopInFault(rig);
  EXPECT_GT(rig.Health().corrupt_frames(), 0u);
  touch.SetFaults({});
  ExpectRecovery(rig, touch);
}

TEST(UsbFaults, CorruptFramesAreDropped) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetFaults({.corrupt_in = 0});
  EXPECT_TRUE(rig.WaitForLog("corrupt frame"));
  EXPECT_TRUE(rig.WaitForLog("omni-usb: no reading for 100 ms; connecting again"));
  ExpectLoopInFault(rig);
  touch.SetFaults({});
  ExpectRecovery(rig, touch);
}

TEST(UsbFaults, SomeBadFramesAreCountedAndTheStreamGoesOn) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  touch.SetBadFrameEvery(10);
  EXPECT_TRUE(rig.WaitForLog(" dropped"));
  const v1::DeviceHealth before = rig.Health();
  ASSERT_TRUE(Eventually([&] { return rig.Health().readings() > before.readings() + 1000; }));
  const v1::DeviceHealth after = rig.Health();
  const auto bad = static_cast<double>(after.corrupt_frames() - before.corrupt_frames());
  const auto good = static_cast<double>(after.readings() - before.readings());
  EXPECT_NEAR(bad, good / 9.0, 0.05 * good) << rig.ExcuseSince(0);
  EXPECT_EQ(after.connection(), DeviceRig::kStreaming);
  EXPECT_EQ(after.connections(), 1u) << rig.ExcuseSince(0);
}

TEST(UsbFaults, LostReadingsAreCounted) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartDocked(rig, touch));
  touch.SetWaitsForForces(true);  // no other loss
  touch.SetLossEvery(5);
  const v1::DeviceHealth before = rig.Health();
  ASSERT_TRUE(Eventually([&] { return rig.Health().readings() > before.readings() + 500; }));
  const v1::DeviceHealth after = rig.Health();
  const auto lost = static_cast<double>(after.lost_readings() - before.lost_readings());
  const auto good = static_cast<double>(after.readings() - before.readings());
  EXPECT_GT(lost, 0.2 * good);
  EXPECT_LT(lost, 0.4 * good) << rig.ExcuseSince(0);
  EXPECT_EQ(after.connection(), DeviceRig::kStreaming);
  EXPECT_EQ(after.problem(), "");
}

TEST(UsbFaults, ADeviceThatTakesNoForceDoesNotHoldTheLoopUp) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetFaults({.deaf = true});
  EXPECT_TRUE(rig.WaitForLog("no force taken for 100 ms; connecting again"));
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  ExpectPace(rig);
  EXPECT_TRUE(Contains(rig.End(), "ended after"));
}

TEST(UsbFaults, DockedMeansNoForce) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetDocked(true);
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_HELD));
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_DOCKED);
  EXPECT_TRUE(rig.WaitForLog("forces: held (docked)"));
  ASSERT_TRUE(TakesForces(touch, 100));
  const std::size_t before = CountForces(touch);
  EXPECT_TRUE(TakesForces(touch, kForcesOfAPress));
  EXPECT_EQ(CountForces(touch), before);
  touch.SetDocked(false);
  EXPECT_TRUE(WaitForForce(rig, touch)) << rig.ExcuseSince(0);
}

TEST(UsbFaults, StopByButtonsAndByCall) {
  TouchEmulator touch;
  DeviceRig rig;
  ASSERT_TRUE(StartWithForces(rig, touch));
  touch.SetButtons(true, true);
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_STOPPED));
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_STOP_BUTTON);
  EXPECT_TRUE(rig.WaitForLog("forces: stopped (stop-button)"));
  touch.SetButtons(false, false);
  ASSERT_TRUE(TakesForces(touch, 100));
  std::size_t before = CountForces(touch);
  EXPECT_TRUE(TakesForces(touch, kForcesOfAPress));
  EXPECT_EQ(CountForces(touch), before);
  ASSERT_TRUE(rig.Enable("omni-usb").ok());
  if (!WaitForForce(rig, touch)) {
    ASSERT_TRUE(PressWithForces(rig, touch));
  }
  ASSERT_TRUE(rig.StopForces().ok());
  ASSERT_TRUE(TakesForces(touch, 100));
  before = CountForces(touch);
  EXPECT_TRUE(TakesForces(touch, kForcesOfAPress));
  EXPECT_EQ(CountForces(touch), before);
  EXPECT_EQ(rig.Forces().reason(), v1::FORCE_REASON_STOP_CALL);
}

}  // namespace
}  // namespace palpate::test
