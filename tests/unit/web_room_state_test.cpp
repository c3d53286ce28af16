// What guests of a room are told of the way to its palpated.
#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <string>

#include "client/web/room/room_state.h"

namespace palpate::web {
namespace {

using client::ConnectionState;
using std::chrono::milliseconds;

const std::string kHere(32, 'a');
const std::string kThere(32, 'b');

struct Room {
  RoomState::Time now{std::chrono::hours(1)};
  RoomState state{kHere, now};

  void Wait(int ms) { now += milliseconds(ms); }
  void Link(bool is_connected) { state.TakeLink(is_connected, now); }
  void Beat(int protocol = kRoomProtocol, const std::string& machine = kHere) {
    state.TakeBeat({.protocol = protocol, .session = "0123456789abcdef", .machine = machine}, now);
  }
  // Beats for this time, one at its end.
  void Publish(int ms) {
    Beat();
    for (int at = 0; at < ms; at += 500) {
      Wait(500);
      Beat();
    }
  }
  void Word(const std::string& state_name, const std::string& why = "") {
    state.TakeText(R"({"type":"connection","state":")" + state_name + R"(","why":")" + why +
                   R"(","palpated":"theatre-2","since_ms":5})");
  }
  ConnectionState At() const { return state.At(now).state; }
  std::string Why() const { return state.At(now).why; }
};

TEST(RoomBeat, ItsProtocolIsAWholeNumber) {
  EXPECT_EQ(ParseBeat(R"({"protocol": 2})")->protocol, 2);
  for (const std::string protocol : {"2.5", "-2", "4294967298", "9223372036854775810", "\"2\""}) {
    EXPECT_FALSE(ParseBeat("{\"protocol\": " + protocol + "}")) << protocol;
  }
}

TEST(RoomState, ThePublishersWordCountsWhileItIsHeard) {
  Room room;
  room.Link(true);
  room.Word("connected");
  EXPECT_EQ(room.At(), ConnectionState::kConnecting);
  for (int beat = 0; beat < 20; ++beat) {
    room.Beat();
    EXPECT_EQ(room.At(), ConnectionState::kConnected);
    EXPECT_EQ(room.Why(), "");
    room.Wait(500);
  }
  EXPECT_EQ(room.state.At(room.now).palpated, "theatre-2");
  room.Word("lost", "palpated is not reached");
  EXPECT_EQ(room.At(), ConnectionState::kLost);
  EXPECT_EQ(room.Why(), "palpated is not reached");
  EXPECT_TRUE(room.state.is_published(room.now));
}

TEST(RoomState, SaysWhatOfTheVolumeIsMissing) {
  std::set<std::string> missing;
  RoomState state{kHere, {}};
  const auto copy = [&](const std::string& problem, const std::string& loading) {
    state.TakeCopyText(R"({"type":"copy","problem":")" + problem + R"(","loading":)" + loading +
                       "}");
    missing.insert(state.MissingVolume());
  };
  state.TakeVolumeLink(true);
  missing.insert(state.MissingVolume());  // not published
  state.TakeVolume();
  EXPECT_EQ(state.MissingVolume(), "");
  copy("palpated sends no voxels", "false");
  copy("40 %", "true");
  EXPECT_TRUE(state.volume().is_loading);
  EXPECT_EQ(state.volume().problem, "40 %");
  state.TakeCopyText(R"({"type":"copy","problem":"","loading":false})");
  EXPECT_EQ(state.MissingVolume(), "");
  state.TakeVolumeLink(false);
  missing.insert(state.MissingVolume());
  EXPECT_EQ(missing.size(), 4u);
  EXPECT_FALSE(missing.contains(""));
}

TEST(RoomState, ASilentPublisherIsAway) {
  Room room;
  room.Link(true);
  room.Word("connected");
  room.Wait(100);
  room.Beat();
  room.Wait(2999);
  EXPECT_EQ(room.At(), ConnectionState::kConnected);
  room.Wait(1);
  EXPECT_EQ(room.At(), ConnectionState::kLost);
  EXPECT_FALSE(room.state.is_published(room.now));
  room.Beat();
  EXPECT_EQ(room.At(), ConnectionState::kConnected);
}

TEST(RoomState, EachReasonIsAnother) {
  std::set<std::string> whys;
  Room room;
  whys.insert(room.Why());
  EXPECT_EQ(room.At(), ConnectionState::kConnecting);
  room.Link(true);
  room.Wait(3000);
  EXPECT_EQ(room.At(), ConnectionState::kLost);  // nobody
  whys.insert(room.Why());
  room.Beat(kRoomProtocol + 1);
  EXPECT_EQ(room.At(), ConnectionState::kLost);  // another version
  EXPECT_FALSE(room.state.is_published(room.now));
  whys.insert(room.Why());
  room.Link(false);
  EXPECT_EQ(room.At(), ConnectionState::kLost);  // NATS, at once
  whys.insert(room.Why());
  room.Link(true);
  room.Publish(3000);
  whys.insert(room.Why());
  EXPECT_EQ(whys.size(), 5u);
  EXPECT_FALSE(whys.contains(""));
}

TEST(RoomState, APublisherWithoutAWordIsGivenAWhileEachTimeThatItComes) {
  Room room;
  room.Link(true);
  const std::string connecting = room.Why();
  room.Publish(2500);
  EXPECT_EQ(room.Why(), connecting);
  room.Publish(500);
  EXPECT_NE(room.Why(), connecting);
  EXPECT_EQ(room.At(), ConnectionState::kConnecting);
  room.Wait(3000);
  room.Beat();
  EXPECT_EQ(room.Why(), connecting);
  room.Publish(3000);
  EXPECT_NE(room.Why(), connecting);
  room.Word("connected");
  EXPECT_EQ(room.At(), ConnectionState::kConnected);
}

TEST(RoomState, AServerThatDoesNotComeIsLostAfterAWhile) {
  Room room;
  room.Link(false);
  room.Wait(2999);
  EXPECT_EQ(room.At(), ConnectionState::kConnecting);
  room.Wait(1);
  EXPECT_EQ(room.At(), ConnectionState::kLost);
}

// The publisher may not be back at a server that was started anew.
TEST(RoomState, BeatsOfBeforeALossDoNotCount) {
  Room room;
  room.Link(true);
  room.Word("connected");
  room.Beat();
  room.Wait(10);
  room.Link(false);
  room.Wait(10);
  room.Link(true);
  EXPECT_EQ(room.At(), ConnectionState::kConnecting);
  room.Beat();
  EXPECT_EQ(room.At(), ConnectionState::kConnected);
}

TEST(RoomState, APublisherOfThisVersionWinsOverAnother) {
  Room room;
  room.Link(true);
  room.Word("connected");
  room.Beat();
  room.Beat(kRoomProtocol + 1, kThere);
  EXPECT_EQ(room.At(), ConnectionState::kConnected);
  EXPECT_TRUE(room.state.shares_clock());
  room.Beat(kRoomProtocol, kThere);
  EXPECT_FALSE(room.state.shares_clock());
}

TEST(RoomState, TextsThatAreNoneChangeNothing) {
  Room room;
  room.Link(true);
  room.Beat();
  for (const char* text :
       {"", "null", "[]", "{", "7", R"({"type":"connection"})", R"({"state":7,"why":""})",
        R"({"state":"fine","why":"","palpated":""})", R"({"state":["connected"]})"}) {
    room.state.TakeText(text);
    EXPECT_EQ(room.At(), ConnectionState::kConnecting) << text;
  }
  room.Word("connected", "but");
  EXPECT_EQ(room.Why(), "");
  room.state.TakeText(R"({"state":"lost","why":{},"palpated":1})");
  EXPECT_EQ(room.At(), ConnectionState::kLost);
  EXPECT_NE(room.Why(), "");
}

}  // namespace
}  // namespace palpate::web
