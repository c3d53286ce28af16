// The Novint Falcon as UsbDevice sees it, without a device and without USB.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "server/device/falcon/bring_up.h"
#include "server/device/falcon/falcon_protocol.h"
#include "server/device/falcon/kinematics.h"
#include "tests/support/scripted_usb_link.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;

// A Falcon with its FTDI chip and its boot loader, as libnifalcon describes them.
class FakeFalcon final {
 public:
  FakeFalcon() {
    usb.found = {.ids = {0x0403, 0xcb48}, .port = "1-2", .may_open = true};
    usb.control = [this](const test::ScriptedUsb::Request& request, std::span<std::uint8_t>) {
      Control(request.request_type, request.request, request.value);
      return std::size_t{0};
    };
    usb.send = [this](const Bytes& bytes) { Written(bytes); };
    usb.receive = [this](std::size_t size) { return Read(size); };
  }
  FakeFalcon(const FakeFalcon&) = delete;
  FakeFalcon& operator=(const FakeFalcon&) = delete;

  test::ScriptedUsb usb{};
  enum class State { kBare, kGreeted, kLoading, kRunning };

  State state = State::kRunning;
  FalconReport report{};
  Bytes loaded{};
  std::size_t firmware_bytes = 0;  // after which it runs
  bool spoils_echo = false;
  std::vector<FalconCommand> commands{};
  int gone_after = -1;  // writes; then the device is unplugged

  void Control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value) {
    EXPECT_EQ(request_type, 0x40);
    if (request == 3) divisor_ = value;
    if (request == 0) answer_.clear();
    if (request == 1 && value == 0x101 && state != State::kRunning) state = State::kBare;
  }

  void Written(std::span<const std::uint8_t> bytes) {
    if (gone_after == 0) throw UsbError(UsbFault::kAbsent, "gone");
    --gone_after;
    if (state == State::kRunning && divisor_ == 2) return Command(bytes);
    if (state == State::kBare && divisor_ == 0x4138) return Greet(bytes);
    if (state == State::kGreeted && divisor_ == 21) return Begin(bytes);
    if (state == State::kLoading && divisor_ == 21) return Load(bytes);
  }

  // Its status, and up to 62 bytes, as a chip with a latency does.
  Bytes Read(std::size_t size) {
    EXPECT_GE(size, kFtdiPacketBytes);
    if (silent_reads-- > 0) return {};
    Bytes packet = {0x31, 0x60};
    const std::size_t take = std::min(answer_.size(), kFtdiPacketBytes - kFtdiStatusBytes);
    const auto end = answer_.begin() + static_cast<std::ptrdiff_t>(take);
    packet.insert(packet.end(), answer_.begin(), end);
    answer_.erase(answer_.begin(), end);
    return packet;
  }

  int silent_reads = 0;

 private:
  void Say(std::span<const std::uint8_t> bytes) {
    answer_.insert(answer_.end(), bytes.begin(), bytes.end());
  }
  void Command(std::span<const std::uint8_t> bytes) {
    const auto command = DecodeFalconCommand(bytes);
    ASSERT_TRUE(command);
    commands.push_back(*command);
    Say(EncodeFalconReport(report));
  }
  void Greet(std::span<const std::uint8_t> bytes) {
    if (!std::ranges::equal(bytes, Bytes{0x0a, 0x43, 0x0d})) return;
    Say(Bytes{0x00, 0x0a, 0x44, 0x2c, 0x0d});
    state = State::kGreeted;
  }
  void Begin(std::span<const std::uint8_t> bytes) {
    if (!std::ranges::equal(bytes, Bytes{0x41})) return;
    Say(bytes);
    state = State::kLoading;
  }
  void Load(std::span<const std::uint8_t> bytes) {
    Bytes echo(bytes.begin(), bytes.end());
    loaded.insert(loaded.end(), bytes.begin(), bytes.end());
    if (spoils_echo && loaded.size() > 1000) echo[0] ^= 1;
    Say(echo);
    if (loaded.size() == firmware_bytes) state = State::kRunning;
  }

  unsigned divisor_ = 0;
  Bytes answer_{};
};

Bytes Transfer(const FalconReport& report) {
  Bytes bytes = {0x31, 0x60};
  const FalconFrame frame = EncodeFalconReport(report);
  bytes.insert(bytes.end(), frame.begin(), frame.end());
  return bytes;
}

FalconReport HomedAt(const Vec3& p_D_mm) {
  Vec3 angles;
  EXPECT_TRUE(FalconAnglesAt(p_D_mm, angles));
  return {.encoders = FalconCountsFromAngles(angles), .buttons = 0, .homed = 7};
}

FalconCommand Encoded(FalconProtocol& protocol, const Vec3& force_D_n, bool forces_on) {
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  const std::size_t size = protocol.Encode(force_D_n, forces_on, out);
  const auto command = DecodeFalconCommand(std::span(out).first(size));
  EXPECT_TRUE(command);
  return command.value_or(FalconCommand{});
}

// The force that the motors' counts put on the hand.
Vec3 ForceOf(const FalconCommand& command, const Vec3& p_D_mm) {
  Vec3 angles;
  Mat3 jacobian;
  EXPECT_TRUE(FalconAnglesAt(p_D_mm, angles));
  EXPECT_TRUE(FalconJacobianAt(p_D_mm, angles, jacobian));
  const Vec3 counts(command.motors[0], command.motors[1], command.motors[2]);
  return jacobian.transpose().inverse() * (counts / kFalconMotorCountsPerNmm);
}

UsbFault FaultOfSetUp(FalconProtocol& protocol, FakeFalcon& falcon, std::string& what,
                      bool stopped = false) {
  test::SetScriptedUsb(falcon.usb);
  UsbLink link(protocol.match());
  const std::atomic<bool> stop(stopped);
  try {
    protocol.SetUp(link, stop);
  } catch (const UsbError& error) {
    what = error.what();
    return error.fault();
  }
  ADD_FAILURE() << "set up";
  return UsbFault::kBroken;
}

TEST(FalconProtocol, SaysWhatItIs) {
  const FalconProtocol protocol(FalconOptions{.port = "1-4"});
  EXPECT_EQ(protocol.spec().kind, "falcon");
  EXPECT_EQ(protocol.spec().verification_level, VerificationLevel::kNone);
  EXPECT_LE(protocol.spec().max_force_n, 3.3);
  EXPECT_LE(protocol.spec().continuous_force_n, protocol.spec().max_force_n);
  EXPECT_EQ(protocol.match().ids, (std::vector<UsbMatch::Ids>{{0x0403, 0xcb48}}));
  EXPECT_EQ(protocol.match().port, "1-4");
  EXPECT_TRUE(protocol.is_request_response());
}

TEST(FalconProtocol, ARunningDeviceIsAskedToHome) {
  FakeFalcon falcon;
  falcon.silent_reads = 1;
  test::SetScriptedUsb(falcon.usb);
  FalconProtocol protocol({});
  UsbLink link(protocol.match());
  const std::atomic<bool> stop(false);
  EXPECT_EQ(protocol.SetUp(link, stop), "Novint Falcon at USB port 1-2");
  ASSERT_FALSE(falcon.commands.empty());
  for (const auto& command : falcon.commands) EXPECT_EQ(command, FalconCommand{});
  EXPECT_NE(std::string(protocol.calibration_hint()).find("pull its grip"), std::string::npos);
  EXPECT_EQ(Encoded(protocol, Vec3(1.0, 1.0, 1.0), true),
            (FalconCommand{.lights = kFalconRedLight, .homing = true}));
  protocol.TearDown(link);
  EXPECT_EQ(falcon.commands.back(), (FalconCommand{.homing = true}));
}

TEST(FalconProtocol, WithoutFirmwareItSaysWhereThatIs) {
  FakeFalcon falcon;
  falcon.state = FakeFalcon::State::kBare;
  FalconProtocol protocol({});
  std::string what;
  EXPECT_EQ(FaultOfSetUp(protocol, falcon, what), UsbFault::kUnsuitable);
  EXPECT_NE(what.find("Novint's firmware"), std::string::npos) << what;
  EXPECT_EQ(what.find('\n'), std::string::npos);
}

class FalconFirmwareTest : public ::testing::Test {
 protected:
  void SetUp() {
    std::mt19937 random(1);
    for (int n = 0; n < 5'000; ++n) firmware_.push_back(static_cast<std::uint8_t>(random()));
    std::ofstream(file_, std::ios::binary)
        .write(reinterpret_cast<const char*>(firmware_.data()),
               static_cast<std::streamsize>(firmware_.size()));
    falcon_.state = FakeFalcon::State::kBare;
    falcon_.firmware_bytes = firmware_.size();
  }

  test::TemporaryFolder folder_{};
  const std::string file_ = folder_.path() / "firmware.bin";
  Bytes firmware_{};
  FakeFalcon falcon_{};
};

TEST_F(FalconFirmwareTest, IsUploadedWhole) {
  test::SetScriptedUsb(falcon_.usb);
  FalconProtocol protocol({.firmware_file = file_});
  UsbLink link(protocol.match());
  const std::atomic<bool> stop(false);
  protocol.SetUp(link, stop);
  EXPECT_EQ(falcon_.loaded, firmware_);
  EXPECT_EQ(falcon_.commands.size(), 1u);
}

TEST_F(FalconFirmwareTest, ThatComesBackWrongIsRefused) {
  falcon_.spoils_echo = true;
  FalconProtocol protocol({.firmware_file = file_});
  std::string what;
  EXPECT_EQ(FaultOfSetUp(protocol, falcon_, what), UsbFault::kCorrupt);
  EXPECT_NE(what.find("plug them in again"), std::string::npos) << what;
}

TEST_F(FalconFirmwareTest, ThatDoesNotRunIsNamed) {
  falcon_.firmware_bytes = firmware_.size() + 1;
  FalconProtocol protocol({.firmware_file = file_});
  std::string what;
  EXPECT_EQ(FaultOfSetUp(protocol, falcon_, what), UsbFault::kTimeout);
  EXPECT_NE(what.find(file_), std::string::npos) << what;
}

TEST_F(FalconFirmwareTest, FileIsReadWithinLimits) {
  EXPECT_EQ(ReadFalconFirmware(file_), firmware_);
  EXPECT_THROW(ReadFalconFirmware(folder_.path() / "none"), UsbError);
  EXPECT_THROW(ReadFalconFirmware(folder_.path()), UsbError);
  const std::string empty = folder_.path() / "empty", huge = folder_.path() / "huge";
  std::ofstream{empty};
  EXPECT_THROW(ReadFalconFirmware(empty), UsbError);
  std::ofstream(huge) << std::string(kMaxFalconFirmwareBytes + 1, 'x');
  EXPECT_THROW(ReadFalconFirmware(huge), UsbError);
}

TEST_F(FalconFirmwareTest, AStopOrAnUnplugEndsTheSetUp) {
  FalconProtocol protocol({.firmware_file = file_});
  std::string what;
  EXPECT_EQ(FaultOfSetUp(protocol, falcon_, what, true), UsbFault::kTimeout);
  falcon_.gone_after = 30;
  EXPECT_EQ(FaultOfSetUp(protocol, falcon_, what), UsbFault::kAbsent);
}

TEST(FalconProtocol, AHomedReadingIsAPosition) {
  FalconProtocol protocol({});
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-28.0, 28.0);
  for (int n = 0; n < 1'000; ++n) {
    const Vec3 p(any(random), any(random), any(random));
    FalconReport report = HomedAt(p);
    report.buttons = static_cast<std::uint8_t>(n % 16);
    DeviceState state;
    state.docked = true;
    const UsbReceived received = protocol.Receive(Transfer(report), state);
    ASSERT_TRUE(received.has_reading);
    ASSERT_TRUE(state.calibrated);
    ASSERT_FALSE(state.docked);
    ASSERT_EQ(state.buttons, report.buttons);
    // Rounded to counts, of which the motions of three arms add up.
    ASSERT_LT((state.p_DHip_mm - p).norm(), 0.0635);
  }
}

TEST(FalconProtocol, TheNewestOfManyReadingsCounts) {
  FalconProtocol protocol({});
  Bytes transfer = {0x31, 0x60};
  for (int n = 0; n < 3; ++n) {
    const FalconFrame frame = EncodeFalconReport(HomedAt(Vec3(0.0, 0.0, 10.0 * n)));
    transfer.insert(transfer.end(), frame.begin(), frame.end());
  }
  transfer.insert(transfer.end(), {'<', 'A', 'A'});
  DeviceState state;
  UsbReceived received = protocol.Receive(transfer, state);
  EXPECT_EQ(received.readings, 3u);
  EXPECT_EQ(received.corrupt_frames, 0u);
  EXPECT_NEAR(state.p_DHip_mm.z(), 20.0, 0.1);
  // The chip's status alone is no reading; what was begun is kept.
  received = protocol.Receive(Bytes{0x31, 0x60}, state);
  EXPECT_FALSE(received.has_reading);
  const FalconFrame rest = EncodeFalconReport({});
  Bytes last = {0x31, 0x60};
  last.insert(last.end(), rest.begin() + 3, rest.end());
  EXPECT_TRUE(protocol.Receive(last, state).has_reading);
}

TEST(FalconProtocol, WithoutHomingThereIsNoPositionAndNoForce) {
  FalconProtocol protocol({});
  DeviceState state;
  protocol.Receive(Transfer(HomedAt(Vec3(1.0, 2.0, 3.0))), state);
  const Vec3 last = state.p_DHip_mm;
  FalconReport half_homed = HomedAt(Vec3(30.0, 0.0, 0.0));
  half_homed.homed = 5;
  EXPECT_TRUE(protocol.Receive(Transfer(half_homed), state).has_reading);
  EXPECT_FALSE(state.calibrated);
  EXPECT_EQ(state.p_DHip_mm, last);
  const FalconCommand command = Encoded(protocol, Vec3(3.0, 0.0, 0.0), true);
  EXPECT_EQ(command, (FalconCommand{.lights = kFalconRedLight, .homing = true}));
}

TEST(FalconProtocol, AnglesThatNoPoseHasAreNotCalibrated) {
  FalconProtocol protocol({});
  DeviceState state;
  EXPECT_TRUE(
      protocol.Receive(Transfer({.encoders = {32767, -32768, 0}, .homed = 7}), state).has_reading);
  EXPECT_FALSE(state.calibrated);
  EXPECT_TRUE(state.p_DHip_mm.allFinite());
  EXPECT_EQ(Encoded(protocol, Vec3(3.0, 0.0, 0.0), true).motors, (std::array<std::int16_t, 3>{}));
}

TEST(FalconProtocol, AForceIsOnTheHandWhereItWasRead) {
  FalconProtocol protocol({});
  std::mt19937 random(2);
  std::uniform_real_distribution<double> any(-28.0, 28.0);
  for (int n = 0; n < 1'000; ++n) {
    DeviceState state;
    protocol.Receive(Transfer(HomedAt(Vec3(any(random), any(random), any(random)))), state);
    const Vec3 force = Vec3(any(random), any(random), any(random)) / 16.0;
    const FalconCommand command = Encoded(protocol, force, true);
    ASSERT_EQ(command.lights, kFalconGreenLight);
    ASSERT_LT((ForceOf(command, state.p_DHip_mm) - force).norm(), 0.01);
  }
  // Towards the user: all three thighs outwards, which is the negative count.
  DeviceState state;
  protocol.Receive(Transfer(HomedAt(Vec3::Zero())), state);
  for (const std::int16_t motor : Encoded(protocol, Vec3(0.0, 0.0, 1.0), true).motors) {
    EXPECT_LT(motor, 0);
  }
}

TEST(FalconProtocol, WithForcesOffOrWithoutANumberTheMotorsAreOff) {
  FalconProtocol protocol({});
  DeviceState state;
  protocol.Receive(Transfer(HomedAt(Vec3::Zero())), state);
  EXPECT_EQ(Encoded(protocol, Vec3(1.0, 1.0, 1.0), false),
            (FalconCommand{.lights = kFalconBlueLight, .homing = true}));
  const Vec3 bad(0.0, std::nan(""), 1.0);
  EXPECT_EQ(Encoded(protocol, bad, true).motors, (std::array<std::int16_t, 3>{}));
  const Vec3 endless(0.0, HUGE_VAL, 1.0);
  EXPECT_EQ(Encoded(protocol, endless, true).motors, (std::array<std::int16_t, 3>{}));
}

TEST(FalconProtocol, ANewConnectionForgetsTheOldOne) {
  FalconProtocol protocol({});
  DeviceState state;
  protocol.Receive(Transfer(HomedAt(Vec3(5.0, 5.0, 5.0))), state);
  FakeFalcon falcon;
  test::SetScriptedUsb(falcon.usb);
  UsbLink link(protocol.match());
  const std::atomic<bool> stop(false);
  protocol.SetUp(link, stop);
  EXPECT_EQ(Encoded(protocol, Vec3(1.0, 1.0, 1.0), true).motors, (std::array<std::int16_t, 3>{}));
}

}  // namespace
}  // namespace palpate
