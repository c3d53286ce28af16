// The Phantom Omni on an emulated FireWire bus, in this process: how it is set up and let go of,
// which way its readings and forces go, and what may go wrong. firewire_card_test.cpp tests the
// emulation; device_daemon_test.cpp has the whole daemon.
#include "server/device/omni/omni_firewire.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/device/firewire/fw_link.h"
#include "tests/support/firewire_testbed.h"
#include "tests/support/omni_stand.h"
#include "tests/support/patience.h"

namespace palpate::test {
namespace {

using Kind = FirewireEvent::Kind;
using Omni = OmniFirewireEmulator;

const std::atomic<bool> kNever{false};

class OmniFirewireTest : public ::testing::Test {
 protected:
  ~OmniFirewireTest() override {
    device_.reset();
    EXPECT_EQ(omni_.Mistakes(), (std::map<std::string, int>{}));
  }

  void Make(const std::string& serial = "", bool has_gains = true) {
    OmniFirewireOptions options{.serial = serial};
    if (has_gains) options.motor_counts_per_n_mm = OmniStand::kGains;
    device_ = std::make_unique<StreamedDevice>(std::make_unique<OmniFirewireBus>(options),
                                               "palpate-fw", 0);
    device_->Start();
  }
  bool Streams() const { return device_->health().connection == DeviceConnection::kStreaming; }
  bool StreamsSoon() {
    return Eventually([&] { return Streams(); });
  }
  bool HasProblem(const std::string& part) {
    return Eventually([&] { return device_->health().problem.find(part) != std::string::npos; });
  }
  void Start() {
    bus_.Plug(omni_);
    Make();
    ASSERT_TRUE(StreamsSoon());
  }
  // Docks until it is calibrated, and holds the stylus there.
  void Hold(const Vec3& p_mm) {
    EXPECT_TRUE(Serve(Vec3::Zero(), [&] {
      const bool calibrated = status_ == DeviceStatus::kOk && state_.calibrated;
      omni_.SetHand(calibrated ? OmniStand::At(p_mm) : OmniStand::Docked());
      return calibrated && !state_.docked && (state_.p_MHip_mm - p_mm).norm() < 0.1;
    })) << state_.p_MHip_mm.transpose();
  }
  // Reads and writes, as the servo does, until it is so.
  bool Serve(const std::function<Vec3()>& force_n, const std::function<bool()>& is_so) {
    return Eventually([&] {
      status_ = device_->Read(state_);
      const bool safe = status_ == DeviceStatus::kOk && state_.calibrated;
      device_->Write({.wrench_M = {safe ? force_n() : Vec3(0, 0, 0)}, .motors_on = safe}, 0.001);
      return is_so();
    });
  }
  bool Serve(const Vec3& force_n, const std::function<bool()>& is_so) {
    return Serve([&] { return force_n; }, is_so);
  }
  Vec3 OnHand() const { return OmniStand::ForceOf(omni_.ForceOnHand(), OmniStand::kRest); }
  bool Pushes() {
    Hold(OmniStand::kRest);
    return Serve(Vec3(0, 0, 1), [&] { return (OnHand() - Vec3(0, 0, 1)).norm() < 0.05; });
  }
  std::vector<FirewireEvent> EventsOf(Kind kind) const {
    std::vector<FirewireEvent> events = omni_.Events();
    std::erase_if(events, [&](const FirewireEvent& event) { return event.kind != kind; });
    return events;
  }

  Omni omni_;
  Omni other_{0x80df6000};
  EmulatedFirewireDevice camera_{0x0814430001234567};
  FirewireTestbed bus_;
  std::unique_ptr<StreamedDevice> device_;
  DeviceState state_;
  DeviceStatus status_ = DeviceStatus::kFault;
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
  EXPECT_EQ(device_->spec().verification_level, VerificationLevel::kNone);
  // A packet for whoever decodes what is unknown of it: magic, encoders, and what follows.
  std::string log;
  while (const std::optional<DeviceEvent> event = device_->NextEvent()) log += event->text + "\n";
  EXPECT_NE(log.find("first packet: 00 00 1e 00 00 00 00 00 00 00 "), std::string::npos) << log;
  ASSERT_TRUE(Pushes());
  device_->Stop();
  EXPECT_FALSE(omni_.Forces().back().force_enabled);
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
  const FirewireEvent last = EventsOf(Kind::kWrite).back();
  EXPECT_EQ(last.number, static_cast<std::int64_t>(Omni::kControl));
  EXPECT_EQ(last.bytes, Bytes{0});
  EXPECT_GE(last.time_ns, omni_.Forces().back().time_ns);  // motors off first
  EXPECT_TRUE(
      Eventually([&] { return omni_.CountOf(Kind::kClose) == omni_.CountOf(Kind::kOpen); }));
}

// A plane on each side of the stylus, 1 mm away, of 0.5 N/mm: the hand goes 2 mm into it.
TEST_F(OmniFirewireTest, EachAxisIsReadAndPushedTheRightWay) {
  Start();
  Hold(OmniStand::kRest);
  for (int n = 0; n < 6; ++n) {
    Vec3 into = Vec3::Zero();
    into[n / 2] = n % 2 == 0 ? 1.0 : -1.0;
    const Vec3 place_mm = OmniStand::kRest + 3.0 * into;
    omni_.SetHand(OmniStand::At(place_mm));
    const auto plane = [&] {
      const double depth_mm = (state_.p_MHip_mm - OmniStand::kRest).dot(into) - 1.0;
      return Vec3(-0.5 * std::max(depth_mm, 0.0) * into);
    };
    const auto felt_n = [&] { return OmniStand::ForceOf(omni_.ForceOnHand(), place_mm); };
    EXPECT_TRUE(Serve(plane, [&] { return (felt_n() + into).norm() < 0.05; }))
        << into.transpose() << ", felt " << felt_n().transpose();
    EXPECT_LT((state_.p_MHip_mm - place_mm).norm(), 0.1);
  }
}

TEST_F(OmniFirewireTest, ButtonsAndTheDockAreRead) {
  Start();
  Hold(OmniStand::kRest);
  for (const unsigned pressed : {1u, 2u, 3u, 0u}) {
    OmniHand hand = OmniStand::At(OmniStand::kRest);
    hand.pressed = pressed;
    omni_.SetHand(hand);
    EXPECT_TRUE(Serve(Vec3::Zero(), [&] { return state_.buttons == pressed; }));
  }
  omni_.SetHand(OmniStand::Docked());
  EXPECT_TRUE(Serve(Vec3::Zero(), [&] { return state_.docked; }));
  // Where the published driver has the dock.
  EXPECT_TRUE(Serve(Vec3::Zero(), [&] {
    return (state_.p_MHip_mm - Vec3(0.0, -70.6, -86.7)).norm() < 0.1;
  })) << state_.p_MHip_mm.transpose();
}

TEST_F(OmniFirewireTest, WithoutMotorFiguresItsMotorsStayOff) {
  bus_.Plug(omni_);
  Make("", false);
  ASSERT_TRUE(StreamsSoon());
  EXPECT_EQ(device_->spec().max_force_n, 0.0);
  Hold(OmniStand::kRest);
  const std::size_t before = omni_.Forces().size();
  EXPECT_TRUE(Serve(Vec3(1, 0, 0), [&] { return omni_.Forces().size() > before + 200; }));
  for (const OmniForcePacket& packet : omni_.Forces()) EXPECT_FALSE(packet.force_enabled);
}

TEST_F(OmniFirewireTest, OfSeveralTheSerialNumberChooses) {
  bus_.Plug(omni_);
  bus_.Plug(other_);
  Make();
  EXPECT_TRUE(HasProblem("11129400000, 70427300007"));
  Make("12345678901");
  EXPECT_TRUE(HasProblem("12345678901"));
  Make("11129400000");
  ASSERT_TRUE(StreamsSoon());
  EXPECT_EQ(omni_.CountOf(Kind::kWrite), 0u);
  EXPECT_GT(other_.packets_sent(), 0u);
  EXPECT_TRUE(other_.unknown_quadlet().empty());  // it disturbs two devices
  device_.reset();
  EXPECT_EQ(other_.Mistakes(), (std::map<std::string, int>{}));
}

TEST_F(OmniFirewireTest, WhatIsMissingIsSaidInOneLine) {
  Make();
  EXPECT_TRUE(HasProblem("not found: plug it in"));
  bus_.Plug(omni_, false);
  EXPECT_TRUE(HasProblem("70-palpate.rules"));
  omni_.vendor_quadlet = 0x00112233;
  bus_.SetMayOpen(omni_, true);
  EXPECT_TRUE(HasProblem("not those of a Phantom Omni"));
  EXPECT_EQ(omni_.CountOf(Kind::kWrite), 0u);
}

TEST_F(OmniFirewireTest, WithoutAFreeChannelNothingIsWritten) {
  bus_.SetFaults({.taken_channels = ~std::uint64_t{0}});
  bus_.Plug(omni_);
  Make();
  EXPECT_TRUE(HasProblem("no free channel"));
  EXPECT_EQ(omni_.CountOf(Kind::kWrite), 0u);
  bus_.SetFaults({});
  EXPECT_TRUE(StreamsSoon());
}

// A device that talks: its program was killed, or another program uses it and holds its channel.
TEST_F(OmniFirewireTest, AnotherProgramsDeviceIsLeftAlone) {
  const std::string node = bus_.Plug(omni_);
  {
    FwLink killed(node);
    killed.Write(Omni::kTalkChannel, std::array<std::uint8_t, 1>{5}, kNever);
    killed.Write(Omni::kControl, std::array<std::uint8_t, 1>{Omni::kStreams}, kNever);
  }
  const std::size_t before = omni_.CountOf(Kind::kWrite);
  bus_.SetFaults({.taken_channels = 1u << 5});
  Make();
  EXPECT_TRUE(HasProblem("another program uses it"));
  EXPECT_EQ(omni_.CountOf(Kind::kWrite), before);
  bus_.SetFaults({});
  EXPECT_TRUE(StreamsSoon());
  EXPECT_EQ(omni_.Register(Omni::kTalkChannel), 5);
}

TEST_F(OmniFirewireTest, PassingAnswersAreAskedAgain) {
  bus_.Plug(omni_);
  for (const std::uint32_t rcode : {RCODE_BUSY, RCODE_GENERATION, RCODE_CANCELLED, RCODE_NO_ACK}) {
    device_.reset();
    omni_.AnswerNext(3, rcode);
    Make();
    EXPECT_TRUE(StreamsSoon()) << rcode;
    EXPECT_GE(device_->health().transfer_errors, 3u);
  }
  device_.reset();
  omni_.AnswerNext(1, kNoResponse);
  Make();
  EXPECT_TRUE(StreamsSoon());
  device_.reset();
  omni_.AnswerNext(1'000'000, RCODE_BUSY);
  Make();
  EXPECT_TRUE(HasProblem("stays busy"));
  omni_.AnswerNext(0, 0);
  EXPECT_TRUE(StreamsSoon());
}

// The device is busy meanwhile. Where the machine stood still, the device looked silent and was set
// up anew, or the gap is the machine's: then once more.
TEST_F(OmniFirewireTest, ABusResetIsFollowedByItsRegistersWhileForcesGoOn) {
  Start();
  for (const bool keeps : {true, false}) {
    omni_.keeps_registers_at_reset = keeps;
    bool went_on = false;
    for (int tries = 0; tries < 20 && !went_on; ++tries) {
      ASSERT_TRUE(StreamsSoon());
      ASSERT_TRUE(Pushes());
      const std::uint64_t connections = device_->health().connections;
      const std::size_t writes = omni_.CountOf(Kind::kWrite), before = omni_.Forces().size();
      omni_.AnswerNext(keeps ? 12 : 1, RCODE_BUSY);
      bus_.BusReset();
      const auto is_restored = [&] {
        const std::vector<FirewireEvent> written = EventsOf(Kind::kWrite);
        return written.size() >= writes + 4 && written.back().rcode == 0 &&
               written.back().number == static_cast<std::int64_t>(Omni::kControl) &&
               written.back().bytes == Bytes{Omni::kStreams};
      };
      EXPECT_TRUE(Serve(Vec3(0, 0, 1), is_restored));
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

// What a device does not hear is no zero, and what it hears next is one.
TEST_F(OmniFirewireTest, ADeviceThatIsDeafAfterABusResetHearsZeroFirst) {
  Start();
  omni_.goes_deaf_at_reset = true;
  ASSERT_TRUE(Pushes());
  std::size_t heard = 0;
  const auto reset = [&] {
    bus_.BusReset();
    omni_.AnswerNext(1'000'000, RCODE_BUSY);
    EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] {
      return std::exchange(heard, omni_.Forces().size()) == omni_.Forces().size();
    }));
  };
  reset();
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(300);
  EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return std::chrono::steady_clock::now() > end; }));
  omni_.AnswerNext(0, 0);
  EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return omni_.Forces().size() > heard; }));
  EXPECT_FALSE(omni_.Forces()[heard].force_enabled);
  // Let go of meanwhile, it is stopped by its register.
  ASSERT_TRUE(Pushes());
  reset();
  omni_.AnswerNext(4, RCODE_BUSY);
  device_->Stop();
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
}

// Its encoders count from elsewhere.
TEST_F(OmniFirewireTest, ADeviceThatBeganAnewAtABusResetIsNotCalibrated) {
  Start();
  omni_.begins_anew_at_reset = true;
  Hold(OmniStand::kRest);
  bus_.BusReset();
  EXPECT_TRUE(Serve(Vec3::Zero(), [&] { return !state_.calibrated; }));
  EXPECT_TRUE(Pushes());
}

// The force of a program that was killed ends before anything is known of the device.
TEST_F(OmniFirewireTest, AnOldForceEndsWhileADeviceIsSetUp) {
  const std::string node = bus_.Plug(omni_);
  {
    FwLink killed(node);
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
  const std::size_t heard = omni_.Forces().size();
  Make();
  EXPECT_TRUE(HasProblem("sends no packets"));
  EXPECT_GT(omni_.Forces().size(), heard + 1);
  EXPECT_FALSE(omni_.Forces()[heard].force_enabled);
  EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
}

TEST_F(OmniFirewireTest, ChannelsThatAreLostAtABusResetEndItsForce) {
  Start();
  ASSERT_TRUE(Pushes());
  omni_.keeps_registers_at_reset = true;
  bus_.SetFaults({.loses_channels_at_reset = true});
  bus_.BusReset();
  EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return status_ == DeviceStatus::kFault; }));
  EXPECT_TRUE(HasProblem("took a channel back"));
  EXPECT_TRUE(Eventually([&] {
    return omni_.Register(Omni::kControl) == 0 && omni_.ForceOnHand() == std::array<int, 3>{};
  }));
  bus_.SetFaults({});
  EXPECT_TRUE(StreamsSoon());
  EXPECT_TRUE(Pushes());
}

TEST_F(OmniFirewireTest, UnpluggedOrSilentItIsAFaultAndComesBack) {
  Start();
  for (int n = 0; n < 2; ++n) {
    ASSERT_TRUE(Pushes());
    bus_.Unplug(omni_);
    EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return status_ == DeviceStatus::kFault; }));
    EXPECT_TRUE(HasProblem("unplugged") || HasProblem("not found"));
    bus_.Plug(omni_);
    ASSERT_TRUE(StreamsSoon());
    EXPECT_FALSE(device_->health().calibrated);  // its encoders count anew
  }
  ASSERT_TRUE(Pushes());
  omni_.SetStream({.silent = true});
  EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return status_ == DeviceStatus::kFault; }));
  EXPECT_TRUE(HasProblem("no reading for 100 ms") || HasProblem("sends no packets"));
  EXPECT_TRUE(Eventually([&] { return omni_.ForceOnHand() == std::array<int, 3>{}; }));
  omni_.SetStream({});
  EXPECT_TRUE(StreamsSoon());
  EXPECT_TRUE(Pushes());
}

TEST_F(OmniFirewireTest, PacketsOfEightAMillisecondAndOf64BytesAreRead) {
  omni_.SetStream({.cycles_per_packet = 1, .payload_bytes = 64, .tag = 1, .gimbal_noise = true});
  Start();
  EXPECT_EQ(device_->health().identity,
            "serial number 70427300007, packets of 64 bytes, 8000 per second");
  ASSERT_TRUE(Pushes());
  const DeviceHealth before = device_->health();
  const std::size_t forces = omni_.Forces().size();
  EXPECT_TRUE(
      Serve(Vec3(0, 0, 1), [&] { return device_->health().readings > before.readings + 8000; }));
  // The kernel tells of each eighth packet: about a force a millisecond.
  EXPECT_LT(omni_.Forces().size(), forces + 2000);
  EXPECT_EQ(device_->health().corrupt_frames, 0u);
}

TEST_F(OmniFirewireTest, PacketsThatAreNoneAreDropped) {
  Start();
  for (const OmniStream& bad : {OmniStream{.payload_bytes = 43}, OmniStream{.payload_bytes = 68},
                                OmniStream{.zero_gimbal = true}}) {
    ASSERT_TRUE(Pushes());
    const std::uint64_t corrupt = device_->health().corrupt_frames;
    omni_.SetStream(bad);
    EXPECT_TRUE(Serve(Vec3(0, 0, 1), [&] { return status_ == DeviceStatus::kFault; }));
    EXPECT_GT(device_->health().corrupt_frames, corrupt);
    EXPECT_TRUE(Eventually([&] { return omni_.ForceOnHand() == std::array<int, 3>{}; }));
    omni_.SetStream({});
    ASSERT_TRUE(StreamsSoon());
  }
}

}  // namespace
}  // namespace palpate::test
