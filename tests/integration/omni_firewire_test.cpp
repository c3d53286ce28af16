// The Phantom Omni on an emulated FireWire bus, in this process: how it is set up and let go of,
// what a bus reset does, and what may go wrong. device_conformance_test.cpp has what all kinds of
// devices promise, device_daemon_test.cpp the whole daemon.
#include "server/device/omni/omni_firewire.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/firewire-cdev.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

#include "server/device/firewire/fw_link.h"
#include "tests/support/omni_rig.h"
#include "tests/support/patience.h"

namespace palpate::test {
namespace {

const std::atomic<bool> kNever{false};

class OmniFirewireTest : public ::testing::Test, protected OmniRig {
 protected:
  void Start() {
    Make();
    ASSERT_TRUE(device_->Streams());
  }
};

TEST_F(OmniFirewireTest, IsSetUpInTheVendorsOrderAndLetGoOfWithoutForce) {
  bus_.Plug(camera_);
  Start();
  const auto written = [&] {
    std::vector<std::int64_t> addresses;
    for (const FirewireEvent& event : EventsOf(Kind::kWrite)) addresses.push_back(event.number);
    return addresses;
  };
  EXPECT_EQ(written(), (std::vector<std::int64_t>{Omni::kListenChannel, Omni::kTalkChannel,
                                                  Omni::kUnknown, Omni::kControl}));
  EXPECT_EQ(omni_.unknown_quadlet(), (Bytes{0x00, 0x00, 0x0f, 0xf8}));
  const DeviceHealth health = device_->health();
  EXPECT_EQ(health.identity, "serial number 70427300007, packets of 44 bytes, 1000 per second");
  EXPECT_EQ((*device_)->spec().verification_level, VerificationLevel::kNone);
  // A packet for whoever decodes what is unknown of it: magic, encoders, and what follows.
  std::string log;
  while (const std::optional<DeviceEvent> event = (*device_)->NextEvent())
    log += event->text + "\n";
  EXPECT_NE(log.find("first packet: 00 00 1e 00 00 00 00 00 00 00 "), std::string::npos) << log;
  ASSERT_TRUE(Pushes());
  (*device_)->Stop();
  ExpectLetGoInOrder();
}

TEST_F(OmniFirewireTest, ButtonsAndTheDockAreRead) {
  Start();
  Place(kRest);
  for (const unsigned pressed : {1u, 2u, 3u, 0u}) {
    OmniHand hand = OmniStand::At(kRest);
    hand.pressed = pressed;
    omni_.SetHand(hand);
    EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().buttons == pressed; }));
  }
  omni_.SetHand(OmniStand::Docked());
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return device_->state().docked; }));
  // Where the published driver has the dock.
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] {
    return (device_->state().p_MHip_mm - Vec3(0.0, -70.6, -86.7)).norm() < 0.1;
  })) << device_->state().p_MHip_mm.transpose();
}

TEST_F(OmniFirewireTest, WithoutMotorFiguresItsMotorsStayOff) {
  Make("", false);
  ASSERT_TRUE(device_->Streams());
  EXPECT_EQ((*device_)->spec().max_force_n, 0.0);
  Place(kRest);
  const std::size_t before = omni_.force_count();
  EXPECT_TRUE(device_->Serve(kPush, [&] { return omni_.force_count() > before + 200; }));
  for (const OmniForcePacket& packet : omni_.Forces()) EXPECT_FALSE(packet.force_enabled);
}

// A device that talks: its program was killed, or another program uses it and holds its channel.
TEST_F(OmniFirewireTest, AnotherProgramsDeviceIsLeftAlone) {
  {
    FwLink killed(node_);
    killed.Write(Omni::kTalkChannel, std::array<std::uint8_t, 1>{5}, kNever);
    killed.Write(Omni::kControl, std::array<std::uint8_t, 1>{Omni::kStreams}, kNever);
  }
  const std::size_t before = omni_.CountOf(Kind::kWrite);
  bus_.SetFaults({.taken_channels = 1u << 5});
  Make();
  EXPECT_TRUE(device_->HasProblem("another program uses it"));
  EXPECT_EQ(omni_.CountOf(Kind::kWrite), before);
  bus_.SetFaults({});
  EXPECT_TRUE(device_->Streams());
  EXPECT_EQ(omni_.Register(Omni::kTalkChannel), 5);
}

TEST_F(OmniFirewireTest, PassingAnswersAreAskedAgain) {
  for (const std::uint32_t rcode : {RCODE_BUSY, RCODE_GENERATION, RCODE_CANCELLED, RCODE_NO_ACK}) {
    device_.reset();
    omni_.AnswerNext(3, rcode);
    Make();
    EXPECT_TRUE(device_->Streams()) << rcode;
    EXPECT_GE(device_->health().transfer_errors, 3u);
  }
  device_.reset();
  omni_.AnswerNext(1, kNoResponse);
  Make();
  EXPECT_TRUE(device_->Streams());
  device_.reset();
  omni_.AnswerNext(1'000'000, RCODE_BUSY);
  Make();
  EXPECT_TRUE(device_->HasProblem("stays busy"));
  omni_.AnswerNext(0, 0);
  EXPECT_TRUE(device_->Streams());
}

// The device is busy meanwhile. Where the machine stood still, the device looked silent and was set
// up anew, or the gap is the machine's: then once more.
TEST_F(OmniFirewireTest, ABusResetIsFollowedByItsRegistersWhileForcesGoOn) {
  Start();
  for (const bool keeps : {true, false}) {
    omni_.keeps_registers_at_reset = keeps;
    bool went_on = false;
    for (int tries = 0; tries < 20 && !went_on; ++tries) {
      ASSERT_TRUE(device_->Streams());
      ASSERT_TRUE(Pushes());
      const std::uint64_t connections = device_->health().connections;
      const std::size_t writes = omni_.CountOf(Kind::kWrite), before = omni_.force_count();
      omni_.AnswerNext(keeps ? 12 : 1, RCODE_BUSY);
      bus_.BusReset();
      const auto is_restored = [&] {
        const std::vector<FirewireEvent> written = EventsOf(Kind::kWrite);
        return written.size() >= writes + 4 && written.back().rcode == 0 &&
               written.back().number == static_cast<std::int64_t>(Omni::kControl) &&
               written.back().bytes == Bytes{Omni::kStreams};
      };
      EXPECT_TRUE(device_->Serve(kPush, is_restored));
      EXPECT_TRUE(Pushes());
      went_on = device_->health().connections == connections;
      if (!went_on) continue;
      std::vector<OmniForcePacket> forces = omni_.Forces();
      forces.erase(forces.begin(), forces.begin() + static_cast<std::ptrdiff_t>(before) - 1);
      std::uint64_t longest_gap = 0;
      for (std::size_t n = 1; n < forces.size(); ++n) {
        longest_gap = std::max(longest_gap, forces[n].cycle - forces[n - 1].cycle);
      }
      went_on = longest_gap < 8u * 100u;
      // No old force comes back at once: without force first.
      EXPECT_TRUE(std::ranges::any_of(
          forces, [](const OmniForcePacket& force) { return !force.force_enabled; }));
    }
    EXPECT_TRUE(went_on);
  }
}

// What a device does not hear is no zero, and what it hears next is one. Where the machine stood
// still, the device was set up anew meanwhile: then once more.
TEST_F(OmniFirewireTest, ADeviceThatIsDeafAfterABusResetHearsZeroFirst) {
  Start();
  omni_.goes_deaf_at_reset = true;
  // Returns how many forces it has heard.
  const auto go_deaf = [&] {
    omni_.AnswerNext(1'000'000, RCODE_BUSY);
    bus_.BusReset();
    return omni_.force_count();
  };
  bool was_deaf = false;
  for (int tries = 0; tries < 20 && !was_deaf; ++tries) {
    ASSERT_TRUE(Pushes());
    const std::size_t heard = go_deaf();
    const std::uint64_t enough = omni_.packets_not_heard() + 300;
    EXPECT_TRUE(device_->Serve(kPush, [&] {
      was_deaf = omni_.packets_not_heard() >= enough;
      return was_deaf || device_->status() == DeviceStatus::kFault;
    }));
    EXPECT_EQ(omni_.force_count(), heard);
    omni_.AnswerNext(0, 0);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return omni_.force_count() > heard; }));
    EXPECT_FALSE(omni_.Forces()[heard].force_enabled);
  }
  EXPECT_TRUE(was_deaf);
  // Let go of meanwhile, it is stopped by its register.
  ASSERT_TRUE(Pushes());
  go_deaf();
  omni_.AnswerNext(4, RCODE_BUSY);
  (*device_)->Stop();
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
}

// Its encoders count from elsewhere.
TEST_F(OmniFirewireTest, ADeviceThatBeganAnewAtABusResetIsNotCalibrated) {
  Start();
  omni_.begins_anew_at_reset = true;
  Place(kRest);
  bus_.BusReset();
  EXPECT_TRUE(device_->Serve(Wrench{}, [&] { return !device_->state().calibrated; }));
  EXPECT_TRUE(Pushes());
}

// The force of a program that was killed ends before anything is known of the device.
TEST_F(OmniFirewireTest, AnOldForceEndsWhileADeviceIsSetUp) {
  {
    FwLink killed(node_);
    std::array<std::uint8_t, 16> frame = {0xff, 0x07, 0xff, 0x07, 0xff, 0x07, 0xc0, 0x53};
    killed.Write(Omni::kListenChannel, std::array<std::uint8_t, 1>{1}, kNever);
    killed.Write(Omni::kTalkChannel, std::array<std::uint8_t, 1>{0}, kNever);
    killed.Write(Omni::kControl, std::array<std::uint8_t, 1>{Omni::kStreams}, kNever);
    killed.StartStream(
        0, 1, [](const FwPacket&) {}, frame);
    frame[0] = 0;
    frame[6] = 0xc8;
    EXPECT_TRUE(Eventually([&] {
      killed.TrySend(frame);
      killed.Wait(std::chrono::microseconds(1000));
      return omni_.ForceOnHand()[0] != 0;
    }));
  }
  omni_.SetStream({.silent = true});
  const std::size_t heard = omni_.force_count();
  Make();
  EXPECT_TRUE(device_->HasProblem("sends no packets"));
  EXPECT_GT(omni_.force_count(), heard + 1);
  EXPECT_FALSE(omni_.Forces()[heard].force_enabled);
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
}

TEST_F(OmniFirewireTest, ChannelsThatAreLostAtABusResetEndItsForce) {
  Start();
  ASSERT_TRUE(Pushes());
  omni_.keeps_registers_at_reset = true;
  bus_.SetFaults({.loses_channels_at_reset = true});
  bus_.BusReset();
  EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }));
  EXPECT_TRUE(device_->HasProblem("took a channel back"));
  EXPECT_TRUE(Eventually([&] {
    return omni_.Register(Omni::kControl) == 0 && omni_.ForceOnHand() == std::array<int, 3>{};
  }));
  bus_.SetFaults({});
  EXPECT_TRUE(device_->Streams());
  EXPECT_TRUE(Pushes());
}

TEST_F(OmniFirewireTest, PacketsOfEightAMillisecondAndOf64BytesAreRead) {
  omni_.SetStream({.cycles_per_packet = 1, .payload_bytes = 64, .tag = 1, .gimbal_noise = true});
  Start();
  EXPECT_EQ(device_->health().identity,
            "serial number 70427300007, packets of 64 bytes, 8000 per second");
  ASSERT_TRUE(Pushes());
  const DeviceHealth before = device_->health();
  const std::size_t forces = omni_.force_count();
  EXPECT_TRUE(
      device_->Serve(kPush, [&] { return device_->health().readings > before.readings + 8000; }));
  // The kernel tells of each eighth packet: about a force a millisecond.
  EXPECT_LT(omni_.force_count(), forces + 2000);
  EXPECT_EQ(device_->health().corrupt_frames, 0u);
}

TEST_F(OmniFirewireTest, PacketsThatAreNoneAreDropped) {
  Start();
  for (const OmniStream& bad : {OmniStream{.payload_bytes = 43}, OmniStream{.payload_bytes = 68},
                                OmniStream{.zero_gimbal = true}}) {
    ASSERT_TRUE(Pushes());
    const std::uint64_t corrupt = device_->health().corrupt_frames;
    omni_.SetStream(bad);
    EXPECT_TRUE(device_->Serve(kPush, [&] { return device_->status() == DeviceStatus::kFault; }));
    EXPECT_GT(device_->health().corrupt_frames, corrupt);
    EXPECT_TRUE(Eventually([&] { return omni_.ForceOnHand() == std::array<int, 3>{}; }));
    omni_.SetStream({});
    ASSERT_TRUE(device_->Streams());
  }
}

// The tests above end with no such mistake.
TEST_F(OmniFirewireTest, TheEmulatedCardNotesWhatNoDriverMayDo) {
  const int node = open(bus_.Plug(camera_).c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(node, 0);
  std::array<char, 100> event{};
  for (int n = 0; n < 2; ++n) {  // nothing has said that there is one
    EXPECT_EQ(read(node, event.data(), event.size()), -1);
  }
  fw_cdev_get_cycle_timer timer{};
  EXPECT_EQ(ioctl(node, FW_CDEV_IOC_GET_CYCLE_TIMER, &timer), -1);
  EXPECT_EQ(camera_.Mistakes().size(), 2u);
  close(node);
}

}  // namespace
}  // namespace palpate::test
