// What panels say: names and times of a session, and the state of the forces.
#include <gtest/gtest.h>

#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "client/view/palpated/panel_words.h"

namespace palpate::view {

namespace {

TEST(ViewSessionWords, Times) {
  EXPECT_EQ(TimeText(0), "0:00");
  EXPECT_EQ(TimeText(999), "0:00");
  EXPECT_EQ(TimeText(12'000), "0:12");
  EXPECT_EQ(TimeText(100'000), "1:40");
  EXPECT_EQ(TimeText(3'599'999), "59:59");
  EXPECT_EQ(TimeText(3'723'000), "1:02:03");
  EXPECT_EQ(SizeText(340'000), "340 kB");
  EXPECT_EQ(SizeText(1'240'000), "1.2 MB");
}

TEST(ViewSessionWords, ANameIsAFileInTheDaemonsFolder) {
  EXPECT_EQ(RecordingPath("/data", "a"), "/data/a.mcap");
  EXPECT_EQ(RecordingPath("/", "a.mcap"), "/a.mcap");
  EXPECT_EQ(RecordingName("/data/a b.mcap"), "a b");
  EXPECT_EQ(RecordingName("/data/other"), "other");
  EXPECT_EQ(RecordingName(".mcap"), ".mcap");
}

TEST(ViewSessionWords, ATakenNameIsRefusedAndTheNextOneIsFree) {
  const client::RecordingList list = {
      {{"/data/a.mcap"}, {"/data/a-2.mcap"}, {"/data/b-9.mcap"}, {"/x/c.mcap"}}, "/data"};
  EXPECT_EQ(FreeName("a", list), "a-3");
  EXPECT_EQ(FreeName("a.mcap", list), "a-3");
  EXPECT_EQ(FreeName("a-2", list), "a-3");
  EXPECT_EQ(FreeName("b-9", list), "b-10");
  EXPECT_EQ(FreeName("c", list), "c");
  EXPECT_NE(NameProblem("a", list), "");
  EXPECT_NE(NameProblem("a.mcap", list), "");
  EXPECT_NE(NameProblem("", list), "");
  EXPECT_NE(NameProblem("../x", list), "");
  EXPECT_EQ(NameProblem("c", list), "");
  EXPECT_NE(NameProblem("c", {}), "");
  // Whatever is taken, there is a free one.
  client::RecordingList many{{{"/d/-1.mcap"}, {"/d/t.mcap"}, {"/d/t-999999.mcap"}}, "/d"};
  for (const char* name : {"-1", "t", "t-999999"}) {
    const std::string free = FreeName(name, many);
    EXPECT_EQ(NameProblem(free, many), "") << free;
  }
}

TEST(RecordingWatch, SaysBeginAndEndOnce) {
  RecordingWatch watch;
  EXPECT_EQ(watch.Take(false), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kBegun);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kEnded);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kNone);
}

TEST(RecordingWatch, NoAnswerIsNoEnd) {
  RecordingWatch watch;
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  watch.Take(true);
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(true), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take({}), RecordingEvent::kNone);
  EXPECT_EQ(watch.Take(false), RecordingEvent::kEnded);
}

}  // namespace

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
