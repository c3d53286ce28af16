// The Novint Falcon as StreamedDevice sees it, without a device and without USB.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <fstream>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "server/device/falcon/falcon_protocol.h"
#include "tests/support/falcon_emulator.h"
#include "tests/support/falcon_stand.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/usb_error.h"

namespace palpate {
namespace {

using test::Bytes;
using test::FalconStand;

Bytes Transfer(const FalconReport& report) {
  Bytes bytes = {0x31, 0x60};
  const FalconFrame frame = EncodeFalconReport(report);
  bytes.insert(bytes.end(), frame.begin(), frame.end());
  return bytes;
}

FalconReport HomedAt(const Vec3& p_D_mm) {
  return {.encoders = FalconStand::At(p_D_mm), .buttons = 0, .homed = 7};
}

class FalconProtocolTest : public ::testing::Test {
 protected:
  FalconProtocolTest() { test::SetDirectUsb(falcon_); }

  StreamReceived Receive(const FalconReport& report) {
    return protocol_->Receive(Transfer(report), state_);
  }
  FalconCommand Encoded(const Vec3& force_D_n, bool forces_on = true) {
    std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
    const std::size_t size = protocol_->Encode({{force_D_n}, forces_on}, out);
    const auto command = DecodeFalconCommand(std::span(out).first(size));
    EXPECT_TRUE(command);
    return command.value_or(FalconCommand{});
  }
  BusError FailureOfSetUp(bool stopped = false) {
    UsbLink link(protocol_->match());
    const std::atomic<bool> stop(stopped);
    return test::BusErrorOf([&] { protocol_->SetUp(link, stop); });
  }

  static constexpr std::array<std::int16_t, 3> kMotorsOff{};
  test::FalconEmulator falcon_;  // without firmware
  std::optional<FalconProtocol> protocol_{FalconOptions{}};
  DeviceState state_;
};

TEST_F(FalconProtocolTest, SaysWhatItIs) {
  protocol_.emplace(FalconOptions{.port = "1-4"});
  EXPECT_EQ(protocol_->spec().verification_level, VerificationLevel::kNone);
  EXPECT_EQ(protocol_->match().ids, (std::vector<UsbMatch::Ids>{{0x0403, 0xcb48}}));
  EXPECT_EQ(protocol_->match().port, "1-4");
  EXPECT_TRUE(protocol_->is_request_response());
}

TEST_F(FalconProtocolTest, ARunningDeviceIsAskedToHomeAndForgetsTheConnectionBefore) {
  Receive(HomedAt(Vec3(5.0, 5.0, 5.0)));
  falcon_.SetFirmware({1});
  falcon_.commands_without_answer = 1;
  UsbLink link(protocol_->match());
  EXPECT_NE(protocol_->SetUp(link, false).find("1-2"), std::string::npos);
  EXPECT_GE(falcon_.Forces().size(), 2u);
  for (const auto& command : falcon_.Forces()) EXPECT_EQ(command, FalconCommand{});
  EXPECT_NE(std::string(protocol_->calibration_hint()).find("pull its grip"), std::string::npos);
  EXPECT_EQ(Encoded(Vec3(1.0, 1.0, 1.0)),
            (FalconCommand{.lights = kFalconRedLight, .homing = true}));
  protocol_->TearDown(link);
  EXPECT_EQ(falcon_.Forces().back(), (FalconCommand{.homing = true}));
}

TEST_F(FalconProtocolTest, WithoutFirmwareItSaysWhereThatIs) {
  const BusError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), BusFault::kUnsuitable);
  EXPECT_TRUE(test::Says(error, "falcon_firmware")) << error.what();
  EXPECT_FALSE(test::Says(error, "\n"));
}

class FalconFirmwareTest : public FalconProtocolTest {
 protected:
  FalconFirmwareTest() { protocol_.emplace(FalconOptions{.firmware_file = firmware_.file()}); }

  const test::FalconFirmware firmware_{};
};

TEST_F(FalconFirmwareTest, IsUploadedWhole) {
  UsbLink link(protocol_->match());
  protocol_->SetUp(link, false);
  EXPECT_EQ(falcon_.firmware(), firmware_.bytes());
  EXPECT_FALSE(falcon_.Forces().empty());
}

TEST_F(FalconFirmwareTest, ThatComesBackWrongIsRefused) {
  falcon_.spoils_echo = true;
  const BusError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), BusFault::kCorrupt);
  EXPECT_TRUE(test::Says(error, "plug them in again")) << error.what();
}

TEST_F(FalconFirmwareTest, ThatDoesNotRunIsNamed) {
  falcon_.cannot_run = true;
  const BusError error = FailureOfSetUp();
  EXPECT_EQ(error.fault(), BusFault::kTimeout);
  EXPECT_TRUE(test::Says(error, firmware_.file())) << error.what();
}

TEST_F(FalconFirmwareTest, FileIsReadWithinLimits) {
  EXPECT_EQ(ReadFalconFirmware(firmware_.file()), firmware_.bytes());
  const test::TemporaryFolder folder;
  const std::string empty = folder.path() / "empty", huge = folder.path() / "huge";
  std::ofstream{empty};
  std::ofstream(huge) << std::string(kMaxFalconFirmwareBytes + 1, 'x');
  for (const std::string& bad :
       {std::string(folder.path() / "none"), folder.path().string(), empty, huge}) {
    EXPECT_THROW(ReadFalconFirmware(bad), BusError) << bad;
  }
}

TEST_F(FalconFirmwareTest, AStopOrAnUnplugEndsTheSetUp) {
  EXPECT_EQ(FailureOfSetUp(true).fault(), BusFault::kTimeout);
  falcon_.SetFaults({.outs_until_gone = 30});
  EXPECT_EQ(FailureOfSetUp().fault(), BusFault::kAbsent);
}

TEST_F(FalconProtocolTest, AHomedReadingIsAPosition) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-28.0, 28.0);
  for (int n = 0; n < 1'000; ++n) {
    const Vec3 p(any(random), any(random), any(random));
    FalconReport report = HomedAt(p);
    report.buttons = static_cast<std::uint8_t>(n % 16);
    state_.docked = true;
    const StreamReceived received = Receive(report);
    ASSERT_TRUE(received.has_reading);
    ASSERT_TRUE(state_.calibrated);
    ASSERT_FALSE(state_.docked);
    ASSERT_EQ(state_.buttons, report.buttons);
    // Rounded to counts, of which the motions of three arms add up.
    ASSERT_LT((state_.p_MHip_mm - p).norm(), 0.0635);
  }
}

TEST_F(FalconProtocolTest, TheNewestOfManyReadingsCounts) {
  Bytes transfer = {0x31, 0x60};
  for (int n = 0; n < 3; ++n) {
    const FalconFrame frame = EncodeFalconReport(HomedAt(Vec3(0.0, 0.0, 10.0 * n)));
    transfer.insert(transfer.end(), frame.begin(), frame.end());
  }
  transfer.insert(transfer.end(), {'<', 'A', 'A'});
  StreamReceived received = protocol_->Receive(transfer, state_);
  EXPECT_EQ(received.readings, 3u);
  EXPECT_EQ(received.corrupt_frames, 0u);
  EXPECT_NEAR(state_.p_MHip_mm.z(), 20.0, 0.1);
  // The chip's status alone is no reading; what was begun is kept.
  received = protocol_->Receive(Bytes{0x31, 0x60}, state_);
  EXPECT_FALSE(received.has_reading);
  const FalconFrame rest = EncodeFalconReport({});
  Bytes last = {0x31, 0x60};
  last.insert(last.end(), rest.begin() + 3, rest.end());
  EXPECT_TRUE(protocol_->Receive(last, state_).has_reading);
}

TEST_F(FalconProtocolTest, WithoutHomingThereIsNoPositionAndNoForce) {
  Receive(HomedAt(Vec3(1.0, 2.0, 3.0)));
  const Vec3 last = state_.p_MHip_mm;
  FalconReport half_homed = HomedAt(Vec3(30.0, 0.0, 0.0));
  half_homed.homed = 5;
  EXPECT_TRUE(Receive(half_homed).has_reading);
  EXPECT_FALSE(state_.calibrated);
  EXPECT_EQ(state_.p_MHip_mm, last);
  const FalconCommand command = Encoded(Vec3(3.0, 0.0, 0.0), true);
  EXPECT_EQ(command, (FalconCommand{.lights = kFalconRedLight, .homing = true}));
}

TEST_F(FalconProtocolTest, AnglesThatNoPoseHasAreNotCalibrated) {
  EXPECT_TRUE(Receive({.encoders = {32767, -32768, 0}, .homed = 7}).has_reading);
  EXPECT_FALSE(state_.calibrated);
  EXPECT_TRUE(state_.p_MHip_mm.allFinite());
  EXPECT_EQ(Encoded(Vec3(3.0, 0.0, 0.0), true).motors, kMotorsOff);
}

TEST_F(FalconProtocolTest, AForceIsOnTheHandWhereItWasRead) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(-28.0, 28.0);
  for (int n = 0; n < 1'000; ++n) {
    Receive(HomedAt(Vec3(any(random), any(random), any(random))));
    const Vec3 force = Vec3(any(random), any(random), any(random)) / 16.0;
    const FalconCommand command = Encoded(force, true);
    ASSERT_EQ(command.lights, kFalconGreenLight);
    ASSERT_LT((FalconStand::ForceOf(command, state_.p_MHip_mm) - force).norm(), 0.01);
  }
  // Towards the user: all three thighs outwards, which is the negative count.
  Receive(HomedAt(Vec3::Zero()));
  for (const std::int16_t motor : Encoded(Vec3(0.0, 0.0, 1.0), true).motors) {
    EXPECT_LT(motor, 0);
  }
}

TEST_F(FalconProtocolTest, WithForcesOffOrWithoutANumberTheMotorsAreOff) {
  Receive(HomedAt(Vec3::Zero()));
  EXPECT_EQ(Encoded(Vec3(1.0, 1.0, 1.0), false),
            (FalconCommand{.lights = kFalconBlueLight, .homing = true}));
  const Vec3 bad(0.0, std::nan(""), 1.0);
  EXPECT_EQ(Encoded(bad, true).motors, kMotorsOff);
  const Vec3 endless(0.0, HUGE_VAL, 1.0);
  EXPECT_EQ(Encoded(endless, true).motors, kMotorsOff);
}

}  // namespace
}  // namespace palpate
