// What the bar of the viewer says of the forces.
#include "client/view/palpated/state_line.h"

#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <utility>
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
  EXPECT_EQ(on.action, ForceAction::kDisable);
  const StateLine stopped = StateOf(Connected(ForceState::kStopped, ForceReason::kStopCall));
  EXPECT_EQ(stopped.tone, Tone::kAlarm);
  EXPECT_EQ(stopped.action, ForceAction::kEnable);
  EXPECT_EQ(StateOf(Connected(ForceState::kOff, ForceReason::kDocked)).tone, Tone::kIdle);
}

// Whatever the last pose said, it is not known to hold.
TEST(StateLine, ClaimsNothingWhenNothingIsHeard) {
  std::vector<KnownState> unknown(5, Connected(ForceState::kOn));
  unknown[0].disconnected = true;
  unknown[1].connection = ConnectionState::kLost;
  unknown[2].connection = ConnectionState::kConnecting;
  unknown[3].silent_s = 0.7;
  unknown[4].forces.reset();
  for (const KnownState& known : unknown) {
    const StateLine line = StateOf(known);
    EXPECT_NE(line.tone, Tone::kActing) << line.text;
    EXPECT_EQ(line.action, ForceAction::kNone) << line.text;
    EXPECT_EQ(line.text.find("forces on"), std::string::npos) << line.text;
  }
  EXPECT_NE(StateOf(unknown[3]).text.find("0.7 s"), std::string::npos);
}

TEST(StateLine, ALostDeviceSaysWhatToDo) {
  KnownState known = Connected(ForceState::kFault, ForceReason::kDevice);
  EXPECT_NE(StateOf(known).text.find("device"), std::string::npos);
  known.device_problem = "no Falcon is connected: plug it in";
  EXPECT_NE(StateOf(known).text.find(known.device_problem), std::string::npos);
}

TEST(StateLine, ForcesThatAreOnButNotFeltAreNotGreen) {
  KnownState known = Connected(ForceState::kOn);
  for (const auto& [mode, tone] : {std::pair{client::ProxyMode::kSuspended, Tone::kIdle},
                                   {client::ProxyMode::kInside, Tone::kCaution},
                                   {client::ProxyMode::kEjecting, Tone::kActing}}) {
    known.mode = mode;
    EXPECT_EQ(StateOf(known).tone, tone);
  }
}

// Whoever replays it, and whatever comes after it.
TEST(StateLine, AReplayIsNoLiveState) {
  const std::string replay = "replay of a by ada: forces are off";
  for (const auto& [state, reason, tone, action, words] :
       {std::tuple{ForceState::kHeld, ForceReason::kReplay, Tone::kCaution, ForceAction::kDisable,
                   "until the replay ends"},
        {ForceState::kOff, ForceReason::kOperator, Tone::kCaution, ForceAction::kEnable,
         "not enabled"},
        {ForceState::kHeld, ForceReason::kDocked, Tone::kCaution, ForceAction::kDisable, "holder"},
        {ForceState::kStopped, ForceReason::kStopCall, Tone::kAlarm, ForceAction::kEnable,
         "emergency stop"}}) {
    KnownState known = Connected(state, reason);
    known.replay = replay;
    const StateLine line = StateOf(known);
    EXPECT_EQ(line.text.find(replay), 0u) << line.text;
    EXPECT_NE(line.text.find(words), std::string::npos) << line.text;
    EXPECT_EQ(line.tone, tone) << line.text;
    EXPECT_EQ(line.action, action) << line.text;
    // What came last is old, whatever it was.
    known.silent_s = 0.7;
    EXPECT_EQ(StateOf(known).text.find("replay"), std::string::npos);
  }
}

// Each state and reason has words, and a sign.
TEST(StateLine, HasWordsForAll) {
  for (int state = 0; state <= static_cast<int>(ForceState::kStopped); ++state) {
    for (int reason = 0; reason <= static_cast<int>(ForceReason::kReplay); ++reason) {
      const StateLine line =
          StateOf(Connected(static_cast<ForceState>(state), static_cast<ForceReason>(reason)));
      EXPECT_FALSE(line.text.empty());
      const bool acts = state == static_cast<int>(ForceState::kOn) ||
                        state == static_cast<int>(ForceState::kRampIn);
      EXPECT_EQ(line.tone == Tone::kActing, acts) << line.text;
    }
  }
}

TEST(FractionIn, IsThatOfALineOfPalpated) {
  EXPECT_EQ(FractionIn("loading head.nrrd, 40 %"), 0.4);
  EXPECT_EQ(FractionIn("loading a, 7 %.nrrd, 100 %"), 1.0);
  for (const char* line : {"", "starting", "loading head.nrrd", "head, 40", "head, x %", "head, %",
                           "head, 400 %", "head, -1 %", "40 %", "head, nan %"}) {
    EXPECT_FALSE(FractionIn(line)) << line;
  }
}

}  // namespace
}  // namespace palpate::view
