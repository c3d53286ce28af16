// What the bar of the viewer says of the forces.
#include "client/view/live/state_line.h"

#include <gtest/gtest.h>

#include <vector>

namespace palpate::view {
namespace {

using client::ConnectionState;
using client::ForceReason;
using client::ForceState;

KnownState Connected(ForceState state, ForceReason reason = ForceReason::kNone) {
  KnownState known;
  known.connection = ConnectionState::kConnected;
  known.forces = client::ForceStatus{.state = state, .reason = reason};
  return known;
}

TEST(StateLine, FollowsTheForces) {
  const StateLine on = StateOf(Connected(ForceState::kOn));
  EXPECT_EQ(on.tone, Tone::kActing);
  EXPECT_EQ(on.text, "forces on");
  EXPECT_EQ(on.action, ForceAction::kDisable);
  const StateLine stopped = StateOf(Connected(ForceState::kStopped, ForceReason::kStopCall));
  EXPECT_EQ(stopped.tone, Tone::kAlarm);
  EXPECT_EQ(stopped.text, "forces stopped: emergency stop");
  EXPECT_EQ(stopped.action, ForceAction::kEnable);
  const StateLine off = StateOf(Connected(ForceState::kOff, ForceReason::kDocked));
  EXPECT_EQ(off.tone, Tone::kIdle);
  EXPECT_EQ(off.text, "forces off: the stylus is docked: take it out");
}

// Whatever the last pose said, it is not known to hold.
TEST(StateLine, ClaimsNothingWhenNothingIsHeard) {
  std::vector<KnownState> unknown(4, Connected(ForceState::kOn));
  unknown[0].disconnected = true;
  unknown[1].connection = ConnectionState::kLost;
  unknown[2].connection = ConnectionState::kConnecting;
  unknown[3].silent_s = 0.7;
  unknown.push_back(Connected(ForceState::kOn));
  unknown[4].forces.reset();
  for (const KnownState& known : unknown) {
    const StateLine line = StateOf(known);
    EXPECT_NE(line.tone, Tone::kActing) << line.text;
    EXPECT_EQ(line.action, ForceAction::kNone) << line.text;
    EXPECT_EQ(line.text.find("forces on"), std::string::npos) << line.text;
  }
  EXPECT_EQ(StateOf(unknown[3]).text, "palpated sends nothing for 0.7 s: forces unknown");
}

TEST(StateLine, ALostDeviceSaysWhatToDo) {
  KnownState known = Connected(ForceState::kFault, ForceReason::kDevice);
  EXPECT_EQ(StateOf(known).text, "forces off after a fault: the device is gone or broken");
  known.device_problem = "no Falcon is connected: plug it in";
  EXPECT_EQ(StateOf(known).text, "forces off after a fault: no Falcon is connected: plug it in");
}

TEST(StateLine, ForcesThatAreOnButSuspendedAreNotGreen) {
  KnownState known = Connected(ForceState::kOn);
  known.mode = client::ProxyMode::kSuspended;
  EXPECT_EQ(StateOf(known).tone, Tone::kIdle);
}

TEST(StateLine, ForcesThatAreOnButNotFeltInsideAreNotGreen) {
  KnownState known = Connected(ForceState::kOn);
  known.mode = client::ProxyMode::kFault;
  EXPECT_EQ(StateOf(known).tone, Tone::kCaution);
  known.mode = client::ProxyMode::kEjecting;
  EXPECT_EQ(StateOf(known).tone, Tone::kCaution);
  known.contact = true;
  EXPECT_EQ(StateOf(known).tone, Tone::kActing);
}

// Each state and reason has words, and a sign.
TEST(StateLine, HasWordsForAll) {
  for (int state = 0; state <= static_cast<int>(ForceState::kStopped); ++state) {
    for (int reason = 0; reason <= static_cast<int>(ForceReason::kStopButton); ++reason) {
      const StateLine line =
          StateOf(Connected(static_cast<ForceState>(state), static_cast<ForceReason>(reason)));
      EXPECT_FALSE(line.text.empty());
      const bool acts = state == static_cast<int>(ForceState::kOn) ||
                        state == static_cast<int>(ForceState::kRampIn);
      EXPECT_EQ(line.tone == Tone::kActing, acts) << line.text;
    }
  }
}

}  // namespace
}  // namespace palpate::view
