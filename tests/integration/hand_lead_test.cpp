// The client library leads the hand of a real palpated. What a bare call may do wrong:
// daemon_lead_test.py. How smoothly the hand follows: led_script_test.
#include "client/sdk/hand_lead.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/calls.h"
#include "server/simulated_hand/stylus_script.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::RestartedDaemon;

bool Names(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// A palpated that touches a sphere in the middle of its workspace.
class HandLeads : public ::testing::Test {
 protected:
  HandLeads() {
    daemon_.Start();
    palpated_.emplace(Server{.address = {.socket_path = daemon_.socket()}});
    palpated_->WaitUntilReached(60s);
  }

  // Every pose from the first on for which `is_last` holds no more; none is lost.
  template <typename Last>
  std::vector<Pose> PosesUntil(const Last& is_last) {
    PoseReader reader = palpated_->ReadPoses(1000.0, 16);
    std::vector<Pose> poses;
    EXPECT_TRUE(Eventually([&] {
      const std::optional<PoseBatch> batch = reader.Next(50ms);
      if (batch) poses.insert(poses.end(), batch->poses.begin(), batch->poses.end());
      return batch && is_last(poses.back());
    }));
    return poses;
  }
  Pose NewestPose() {
    return PosesUntil([](const Pose&) { return true; }).back();
  }
  bool Rests(const Vec3& p_mm, double within_mm) {
    return Eventually([&] { return (NewestPose().hip_mm - p_mm).norm() < within_mm; });
  }
  Vec3 Center() { return palpated_->GetPlacement().registration.center_mm; }
  std::string LedBy() { return palpated_->GetDevice().hand_led_by; }

  RestartedDaemon daemon_{{"--volume", "builtin:sphere:48"}};
  std::optional<Calls> palpated_;
};

// The message that brings a target also brings its buttons, so the poses themselves tell when it
// came.
TEST_F(HandLeads, ItGoesWhereItIsLedWithinFiftyTicks) {
  constexpr double kFreeMm = 30.0;  // z: above the sphere
  constexpr double kStepMm = 4.0, kRestMm = 0.3;
  constexpr std::uint64_t kFollowTicks = 50;
  const auto hand = palpated_->LeadHand();
  Vec3 target_mm(0.0, 0.0, kFreeMm);
  hand->MoveTo(target_mm);
  ASSERT_TRUE(Rests(target_mm, kRestMm)) << hand->problem();
  EXPECT_EQ(hand->state(), HandLeadState::kLeading);
  for (std::uint32_t n = 1; n <= 6; ++n) {
    const std::uint32_t buttons = n % 2;
    target_mm.x() += kStepMm;
    std::optional<std::uint64_t> came;
    bool is_there = false;
    PoseReader reader = palpated_->ReadPoses(1000.0, 1);
    reader.Next(1s);
    hand->MoveTo(target_mm, buttons);
    ASSERT_TRUE(Eventually([&] {
      const std::optional<PoseBatch> batch = reader.Next(50ms);
      if (!batch) return false;
      for (const Pose& pose : batch->poses) {
        if (!came && pose.buttons == buttons) came = pose.tick + pose.missed_ticks;
        if (!came || pose.tick + pose.missed_ticks < *came + kFollowTicks) continue;
        is_there = (pose.hip_mm - target_mm).norm() < 0.1 * kStepMm;
        return true;
      }
      return false;
    }));
    EXPECT_TRUE(is_there) << n;
  }
}

TEST_F(HandLeads, TheSphereKeepsTheProxyOutsideAndDeflectsTheHand) {
  const Vec3 center_mm = Center();
  const auto hand = palpated_->LeadHand();
  const auto dip = [&](double angle, double away_mm) -> Vec3 {
    return center_mm + away_mm * Vec3(std::cos(angle), std::sin(angle), 0.0);
  };
  hand->MoveTo(dip(0.0, 50.0));
  ASSERT_TRUE(Rests(dip(0.0, 50.0), 0.3)) << hand->problem();
  // In at one side, and along the surface below it.
  PoseReader reader = palpated_->ReadPoses(1000.0, 16);
  int contacts = 0, deeper = 0;
  double angle = 0.0, away_mm = 50.0;
  Pose last;
  ASSERT_TRUE(Eventually([&] {
    const std::optional<PoseBatch> batch = reader.Next(50ms);
    if (!batch) return false;
    for (const Pose& pose : batch->poses) {
      last = pose;
      if (pose.density > pose.isovalue + 1e-9) ADD_FAILURE() << "inside at tick " << pose.tick;
      if (!pose.contact) continue;
      ++contacts;
      deeper += (pose.hip_mm - center_mm).norm() < (pose.scp_h_mm - center_mm).norm();
    }
    if (last.contact) {
      angle += 0.02;
    } else {
      away_mm -= 0.5;
    }
    hand->MoveTo(dip(angle, away_mm));
    return angle > 2.0 || HasFailure();
  }));
  EXPECT_GT(contacts, 500);
  EXPECT_GT(deeper, contacts / 2);
  // At rest the resistance is what the person sees: the way from the target to the hand.
  const Vec3 target_mm = dip(angle, away_mm - 5.0);
  hand->MoveTo(target_mm);
  ASSERT_TRUE(Eventually([&] {
    last = NewestPose();
    return (last.hip_mm - target_mm - last.force_n / kHandSpringNPerMm).norm() < 0.3;
  })) << (last.hip_mm - target_mm).transpose()
      << " and " << last.force_n.transpose();
  EXPECT_GT(last.force_n.norm(), 0.1);
}

TEST_F(HandLeads, OneAtATimeAndTheHandExploresAfterwards) {
  EXPECT_EQ(LedBy(), "");
  Calls others(Server{.address = {.socket_path = daemon_.socket()}});
  auto first = palpated_->LeadHand();
  EXPECT_EQ(first->state(), HandLeadState::kBeginning);
  EXPECT_EQ(LedBy(), "");  // not before its first target
  const Vec3 place_mm(60.0, 40.0, 20.0);
  first->MoveTo(place_mm);
  ASSERT_TRUE(Eventually([&] { return first->state() == HandLeadState::kLeading; }));
  EXPECT_EQ(LedBy(), "local socket");
  {
    const auto second = others.LeadHand();
    second->MoveTo(Vec3::Zero());
    ASSERT_TRUE(Eventually([&] { return second->state() == HandLeadState::kEnded; }));
    EXPECT_TRUE(Names(second->problem(), "local socket")) << second->problem();
  }
  EXPECT_TRUE(Rests(place_mm, 0.3));
  EXPECT_EQ(first->state(), HandLeadState::kLeading) << first->problem();
  first.reset();
  EXPECT_TRUE(Eventually([&] { return LedBy().empty(); }));
  EXPECT_TRUE(Eventually([&] { return (NewestPose().hip_mm - place_mm).norm() > 20.0; }));
  const auto third = others.LeadHand();
  third->MoveTo(place_mm);
  EXPECT_TRUE(Rests(place_mm, 0.3)) << third->problem();
}

TEST_F(HandLeads, ItSaysWhyItEndedAndEndsAtOnce) {
  const auto strange = palpated_->LeadHand();
  strange->MoveTo(Vec3(0.0, std::nan(""), 0.0));
  ASSERT_TRUE(Eventually([&] { return strange->state() == HandLeadState::kEnded; }));
  EXPECT_TRUE(Names(strange->problem(), "target_mm")) << strange->problem();

  const auto killed = palpated_->LeadHand();
  killed->MoveTo(Vec3::Zero());
  ASSERT_TRUE(Eventually([&] { return killed->state() == HandLeadState::kLeading; }));
  daemon_.Kill();
  ASSERT_TRUE(Eventually([&] { return killed->state() == HandLeadState::kEnded; }));
  EXPECT_FALSE(killed->problem().empty());
  const auto unreached = palpated_->LeadHand();
  unreached->MoveTo(Vec3::Zero());
  ASSERT_TRUE(Eventually([&] { return unreached->state() == HandLeadState::kEnded; }));
  EXPECT_FALSE(unreached->problem().empty());
  palpated_->LeadHand();  // never moved

  // A daemon that stands still keeps nobody waiting.
  daemon_.Start();
  palpated_->WaitUntilReached(60s);
  auto hung = palpated_->LeadHand();
  hung->MoveTo(Vec3::Zero());
  ASSERT_TRUE(Eventually([&] { return hung->state() == HandLeadState::kLeading; }));
  daemon_.Hang();
  hung.reset();
  daemon_.Continue();
  EXPECT_TRUE(Eventually([&] { return LedBy().empty(); }));
}

// A recording of it has all that palpate-lab computes it from, and drives a device that cannot be
// led.
TEST_F(HandLeads, ARecordingOfItComesBackBitForBit) {
  const std::string file = daemon_.folder() / "led.mcap";
  const Vec3 center_mm = Center();
  palpated_->StartRecording(file);
  auto hand = palpated_->LeadHand();
  int n = 0;
  ASSERT_TRUE(Eventually([&] {
    hand->MoveTo(center_mm + Vec3(10.0 * std::sin(0.05 * n), 4.0, 45.0 - 0.2 * n), n / 50 % 2);
    ++n;
    return palpated_->GetRecording().ticks > 2000 && n > 200;
  }));
  const RecordingState state = palpated_->StopRecording();
  hand.reset();
  const test::ProcessResult replayed =
      test::Process({test::kPalpateLab, "replay", "--recording", file}).Wait();
  EXPECT_EQ(replayed.exit_code, 0) << replayed.output << replayed.error;
  EXPECT_GT(state.ticks, 2000u);

  RestartedDaemon other({"--volume", "builtin:sphere:32"},
                        "[device]\nkind = \"replay\"\nreplay_file = \"" + file + "\"\n");
  other.Start();
  Calls there(Server{.address = {.socket_path = other.socket()}});
  const auto refused = there.LeadHand();
  refused->MoveTo(Vec3::Zero());
  ASSERT_TRUE(Eventually([&] { return refused->state() == HandLeadState::kEnded; }));
  EXPECT_TRUE(Names(refused->problem(), "replay")) << refused->problem();
  EXPECT_EQ(there.GetDevice().hand_led_by, "");
}

}  // namespace
}  // namespace palpate::client
