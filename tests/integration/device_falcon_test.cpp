// A real daemon with an emulated Novint Falcon: its firmware, its stream, its faults.
#include <gtest/gtest.h>

#include "server/device/falcon/kinematics.h"
#include "tests/integration/device_rig.h"
#include "tests/support/falcon_emulator.h"

namespace palpate::test {
namespace {

using Kind = UsbEvent::Kind;

Bytes Firmware(std::size_t count) {
  Bytes bytes(count);
  for (std::size_t n = 0; n < count; ++n) bytes[n] = static_cast<std::uint8_t>(n * 7 + n / 251);
  return bytes;
}

void MoveTo(FalconEmulator& falcon, const Vec3& p_mm) {
  Vec3 angles_rad;
  ASSERT_TRUE(FalconAnglesAt(p_mm, angles_rad));
  falcon.SetEncoders(FalconCountsFromAngles(angles_rad));
}

// From below the sphere into it, at the speed of a hand.
void Press(FalconEmulator& falcon) {
  for (double y_mm = -47.0; y_mm < -28.0; y_mm += 0.5) {
    MoveTo(falcon, Vec3(0.0, y_mm, 0.0));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

// False where a fault ends the forces: the machine stopped for long.
bool Pushes(DeviceRig& rig, const FalconEmulator& falcon) {
  const auto is_fault = [&] { return rig.Forces().state() == v1::FORCE_STATE_FAULT; };
  return Eventually([&] { return !falcon.Forces().back().IsZero() || is_fault(); }) && !is_fault();
}

std::string Config(const std::string& more = "") { return "kind = \"falcon\"\n" + more; }

class FalconDevice : public testing::Test {
 protected:
  // `[device]` lines that name a firmware of these bytes.
  std::string WithFirmware(const Bytes& bytes) {
    const std::filesystem::path file = folder_.path() / "firmware.bin";
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    return Config("falcon_firmware = \"" + file.string() + "\"\n");
  }

  // Streaming, enabled, and pushing a hand that presses.
  testing::AssertionResult PressWithForces(DeviceRig& rig, FalconEmulator& falcon) {
    return WhereTheBusRuns(rig, [&] {
      MoveTo(falcon, Vec3(0.0, -47.0, 0.0));
      if (!rig.WaitForConnection(DeviceRig::kStreaming)) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(300));  // it has moved
      if (!rig.EnableAndWait("falcon")) return false;
      Press(falcon);
      return Pushes(rig, falcon);
    });
  }
  void StartPushing(DeviceRig& rig, FalconEmulator& falcon) {
    rig.bus().Plug("1-2", falcon);
    rig.Start(Config());
    ASSERT_TRUE(PressWithForces(rig, falcon));
  }
  // Lost, and back: the loop went on without forces, which stay off until enabled.
  void ExpectFaultAndRecovery(DeviceRig& rig, FalconEmulator& falcon) {
    EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
    EXPECT_TRUE(rig.WaitForLog("forces: fault (device)"));
    EXPECT_TRUE(falcon.Forces().back().IsZero());
    const std::uint64_t ticks = rig.Get().servo().ticks();
    EXPECT_TRUE(Eventually([&] { return rig.Get().servo().ticks() > ticks + 100; }));
    falcon.SetFaults({});
    falcon.EndStalls();
    EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
    EXPECT_EQ(rig.Forces().state(), v1::FORCE_STATE_FAULT);
    EXPECT_TRUE(PressWithForces(rig, falcon));
  }

  TemporaryFolder folder_;
};

TEST_F(FalconDevice, IsGivenItsFirmware) {
  FalconEmulator falcon(false);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  const Bytes firmware = Firmware(5000);
  rig.Start(WithFirmware(firmware));
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_EQ(falcon.firmware(), firmware);
  EXPECT_TRUE(rig.WaitForLog("falcon on USB port 1-2: connected"));
}

TEST_F(FalconDevice, WithFirmwareOfBeforeItNeedsNone) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(Config());
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_TRUE(falcon.firmware().empty());
}

TEST_F(FalconDevice, WithoutFirmwareItSaysWhatToDo) {
  FalconEmulator falcon(false);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(Config());
  EXPECT_TRUE(rig.WaitForLog("it has no firmware yet; set [device] falcon_firmware"));
  EXPECT_TRUE(Contains(rig.Health().problem(), "no firmware yet")) << rig.Health().problem();
  EXPECT_NE(rig.Health().connection(), DeviceRig::kStreaming);
}

TEST_F(FalconDevice, FirmwareThatComesBackWrongIsRefused) {
  FalconEmulator falcon(false);
  falcon.SetEchoErrors(true);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(WithFirmware(Firmware(500)));
  EXPECT_TRUE(rig.WaitForLog("did not take its firmware"));
  EXPECT_FALSE(falcon.has_firmware());
  EXPECT_TRUE(falcon.Forces().empty());
  falcon.SetEchoErrors(false);
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
}

// One answer for one force: what the bus takes of time is lost to both.
TEST_F(FalconDevice, ExchangesFramesOneForOne) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(Config());
  ASSERT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  const v1::DeviceHealth before = rig.Health();
  EXPECT_TRUE(Eventually([&] { return rig.Health().readings() > before.readings() + 3000; }));
  const v1::DeviceHealth after = rig.Health();
  const auto readings = static_cast<double>(after.readings() - before.readings());
  const auto forces = static_cast<double>(after.forces_written() - before.forces_written());
  RecordProperty("readings", static_cast<int>(readings));
  EXPECT_NEAR(forces, readings, 0.02 * readings + 5.0);
  EXPECT_EQ(after.corrupt_frames(), before.corrupt_frames());
  EXPECT_EQ(after.connections(), 1u) << rig.ExcuseSince(0);
}

TEST_F(FalconDevice, ForcesAreOffUntilItIsHomedAndEnabled) {
  FalconEmulator falcon(true);
  falcon.SetHomed(false);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(Config());
  ASSERT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_FALSE(rig.Health().calibrated());
  falcon.SetHomed(true);
  EXPECT_TRUE(Eventually([&] { return rig.Health().calibrated(); }));
  EXPECT_EQ(rig.Enable("").error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(rig.Forces().state(), v1::FORCE_STATE_OFF);
  for (const FalconForce& force : falcon.Forces()) ASSERT_TRUE(force.IsZero());
  EXPECT_TRUE(PressWithForces(rig, falcon));
}

TEST_F(FalconDevice, UnpluggedItForgetsItsFirmwareAndIsGivenItAgain) {
  FalconEmulator falcon(false);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(WithFirmware(Firmware(300)));
  ASSERT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForLog("falcon: unplugged; looking for it again"));
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kAbsent));
  rig.bus().Plug("1-2", falcon);
  EXPECT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  EXPECT_TRUE(falcon.has_firmware());
  EXPECT_EQ(rig.Health().connections(), 2u);
}

TEST_F(FalconDevice, SilenceEndsTheConnection) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon);
  rig.Start(Config());
  ASSERT_TRUE(rig.WaitForConnection(DeviceRig::kStreaming));
  falcon.SetFaults({.silent = true});
  EXPECT_TRUE(rig.WaitForLog("falcon: no reading for 100 ms; connecting again"));
  falcon.SetFaults({});
  EXPECT_TRUE(Eventually([&] { return rig.Health().connections() == 2; }));
}

TEST_F(FalconDevice, FailingWhileItPushesItIsAFault) {
  struct Case {
    const char* name;
    UsbFaults faults;
    const char* line;
  };
  for (const Case& fault : {Case{"silent", {.silent = true}, "no reading for 100 ms"},
                            Case{"short", {.cut_in_to = 9}, "no reading for 100 ms"},
                            Case{"corrupt", {.corrupt_in = 2}, "corrupt frame"},
                            Case{"deaf", {.deaf = true}, "falcon: no "}}) {
    SCOPED_TRACE(fault.name);
    FalconEmulator falcon(true);
    DeviceRig rig;
    StartPushing(rig, falcon);
    falcon.SetFaults(fault.faults);
    EXPECT_TRUE(rig.WaitForLog(fault.line));
    if (fault.faults.deaf) {
      // Nothing reaches it, zero force neither; the loop goes on all the same.
      EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
      continue;
    }
    ExpectFaultAndRecovery(rig, falcon);
  }
}

TEST_F(FalconDevice, AStallThatStaysIsAFault) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  StartPushing(rig, falcon);
  falcon.Stall(FalconEmulator::kIn, true);
  EXPECT_TRUE(rig.WaitForLog("the device refused"));
  ExpectFaultAndRecovery(rig, falcon);
}

TEST_F(FalconDevice, UnpluggedWhileItPushesZeroForceIsAttempted) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  StartPushing(rig, falcon);
  rig.bus().Unplug("1-2");
  EXPECT_TRUE(rig.WaitForLog("falcon: unplugged; looking for it again"));
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_GT(falcon.CountOf(Kind::kLateOut), 0u);
}

TEST_F(FalconDevice, OfTwoOneMustBeNamed) {
  FalconEmulator one(true), two(true);
  DeviceRig rig;
  rig.bus().Plug("1-1", one);
  rig.bus().Plug("1-2", two);
  rig.Start(Config());
  EXPECT_TRUE(rig.WaitForLog("falcon: several are plugged in, on USB ports 1-1, 1-2"));
  EXPECT_EQ(rig.Health().connection(), DeviceRig::kAbsent);
}

TEST_F(FalconDevice, WithoutPermissionItSaysWhatToDo) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  rig.bus().Plug("1-2", falcon, false);
  rig.Start(Config(), true);
  EXPECT_TRUE(rig.WaitForLog("this user may not open the device"));
  EXPECT_EQ(rig.Health().connection(), DeviceRig::kAbsent);
}

TEST_F(FalconDevice, IsLetGoOfWithZeroForce) {
  FalconEmulator falcon(true);
  DeviceRig rig;
  StartPushing(rig, falcon);
  EXPECT_TRUE(Contains(rig.End(), "ended after"));
  ASSERT_TRUE(Eventually([&] { return falcon.CountOf(Kind::kClose) > 0; }));
  EXPECT_TRUE(falcon.Forces().back().IsZero());
  EXPECT_EQ(falcon.CountOf(Kind::kRelease), 1u);
  EXPECT_EQ(falcon.CountOf(Kind::kAttachDriver), 1u);
}

}  // namespace
}  // namespace palpate::test
