// A room's copy against a simple model of the room: publishers, a server that keeps the newest
// message of each subject, and a line that loses, damages, delays and invents messages. Whatever
// comes, each volume that is shown is one that was published whole, and every blob that it names is
// there with its bytes.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client/web/room/room_copy.h"
#include "tests/support/plain_room.h"

namespace palpate::web {
namespace {

std::string Damaged(std::string bytes, Random& random) {
  if (bytes.empty()) return bytes;
  switch (random() % 5) {
    case 0:
      return bytes.substr(0, random() % bytes.size());
    case 1:
      return bytes + static_cast<char>(random());
    case 2:  // the header
      bytes[random() % std::min<std::size_t>(bytes.size(), 22)] ^= static_cast<char>(random());
      return bytes;
    case 3: {  // other bytes under the same name
      if (bytes.size() < 23) return bytes;
      return bytes.substr(0, 22) + Zip(RandomGroup(random));
    }
    default:
      bytes[random() % bytes.size()] ^= static_cast<char>(1U << random() % 8);
      return bytes;
  }
}

struct Line {
  unsigned lost = 0, damaged = 0, reordered = 0;  // of 1000 messages
  bool two_publishers = false;
};

// The room, and the copy that follows it.
class Rig {
 public:
  Rig(Line line, unsigned seed) : line_(line), random_(seed) {}

  void Run(int steps) {
    for (int n = 0; n < steps && !testing::Test::HasFatalFailure(); ++n) Step();
  }
  // No more of what is bad: one publisher says everything anew.
  void Heal() {
    line_ = {};
    shown_revision_ = 0;
    waiting_.at(0).clear();
    waiting_.at(1).clear();
    PlainVolumeState none;
    none.size = Vec3i::Constant(96);
    for (std::uint32_t n = 0; n < none.count(); ++n) none.groups[n] = "";
    states_.at(0) = Edited(states_.at(0), random_);
    published_[states_.at(0).message] = states_.at(0);
    for (const auto& one : MessagesOf(states_.at(0), none, subjects_, random_)) Keep(one);
    Reconnect();
    for (int n = 0; n < 3000 && !copy_.is_complete(); ++n) {
      Deliver();
      if (n % 500 == 499) copy_.AskAnew(false);
    }
    EXPECT_TRUE(copy_.is_complete());
    EXPECT_EQ(shown_, states_.at(0).message);
    EXPECT_EQ(copy_.missing_groups(), 0U);
    // What is in use is what is shown and nothing else.
    now_ += std::chrono::hours(1);
    copy_.Expire(now_);
    std::set<std::string> distinct;
    for (const auto& [number, bytes] : states_.at(0).groups) distinct.insert(bytes);
    distinct.insert(states_.at(0).overview);
    EXPECT_EQ(copy_.shelf().size(), distinct.size() + 1);
    EXPECT_EQ(copy_.shelf().superseded_bytes(), 0U);
    if (published_.count(shown_) > 0) JudgeShown(published_[shown_]);
  }

  void Step() {
    now_ += std::chrono::milliseconds(random_() % 20);
    const std::size_t who = line_.two_publishers ? random_() % 2 : 0;
    if (waiting_.at(who).empty() && random_() % 4 == 0) Publish(who);
    for (int n = 0; n < 4 && !waiting_.at(who).empty(); ++n) {
      Keep(waiting_.at(who).front());
      waiting_.at(who).pop_front();
    }
    if (random_() % 300 == 0) Reconnect();
    if (random_() % 50 == 0 && !copy_.is_complete()) copy_.AskAnew(false);
    Deliver();
    // What is shown stays there for long.
    if (random_() % 50 == 0) {
      now_ += std::chrono::hours(1);
      copy_.Expire(now_);
      if (published_.count(shown_) > 0) JudgeShown(published_[shown_]);
    }
  }

  int shows() const { return shows_; }

 private:
  void Publish(std::size_t who) {
    const PlainVolumeState before = states_.at(who);
    states_.at(who) = Edited(before, random_);
    published_[states_.at(who).message] = states_.at(who);
    for (auto& one : MessagesOf(states_.at(who), before, subjects_, random_)) {
      waiting_.at(who).push_back(std::move(one));
    }
  }
  bool Happens(unsigned of_1000) { return random_() % 1000 < of_1000; }

  // The server: keeps it and sends it to subscribers.
  void Keep(const std::pair<std::string, std::string>& message) {
    kept_[message.first] = message.second;
    live_.push_back(message);
  }

  void Reconnect() {
    live_.clear();
    asked_.clear();
    answers_.clear();
    copy_.AskAnew(true);
  }

  void Deliver() {
    const auto asks = copy_.Asks(16);
    asked_.insert(asked_.end(), asks.begin(), asks.end());
    // An ask is served at some time, and the answer comes at some later time.
    for (std::size_t n = random_() % 6; n > 0 && !asked_.empty(); --n) {
      const auto found = kept_.find(asked_.front());
      answers_.emplace_back(asked_.front(), found == kept_.end() ? "" : found->second);
      asked_.pop_front();
    }
    for (std::size_t n = random_() % 8; n > 0 && !live_.empty(); --n) Receive(live_, true);
    for (std::size_t n = random_() % 6; n > 0 && !answers_.empty(); --n) Receive(answers_, false);
  }

  void Receive(std::deque<std::pair<std::string, std::string>>& line, bool is_live) {
    if (Happens(line_.reordered)) std::swap(line.front(), line[random_() % line.size()]);
    auto [subject, bytes] = line.front();
    line.pop_front();
    if (Happens(line_.lost)) return;
    if (Happens(line_.damaged)) {
      const bool is_text = subject == subjects_.volume();
      if (random_() % 4 == 0) subject = subjects_.group(random_() % 30);
      if (!is_text) bytes = Damaged(bytes, random_);
    }
    const RoomCopy::News news =
        is_live ? copy_.TakeLive(subject, bytes, now_) : copy_.TakeAnswer(subject, bytes, now_);
    if (news.shown) Judge(*news.shown);
  }

  void Judge(const RoomCopy::Shown& shown) {
    ++shows_;
    shown_ = RoomVolumeBytes(shown);
    const auto found = published_.find(shown_);
    ASSERT_NE(found, published_.end()) << "texts that were never published together";
    if (line_.reordered == 0 && line_.lost == 0 && !line_.two_publishers) {
      ASSERT_GE(found->second.revision, shown_revision_) << "an older volume";
    }
    shown_revision_ = found->second.revision;
    JudgeShown(found->second);
  }

  void JudgeBlob(const std::string& name, const std::string& bytes) {
    const BlobPtr blob = copy_.Find(name);
    ASSERT_TRUE(blob);
    ASSERT_EQ(blob->name(), name);
    ASSERT_TRUE(*blob->Encoded(Encoding::kIdentity) == bytes);
  }

  void JudgeShown(const PlainVolumeState& state) {
    JudgeBlob(state.name, state.manifest);
    JudgeBlob(Hex(HashBytes(0, state.overview)), state.overview);
    for (const auto& [number, bytes] : state.groups) JudgeBlob(Hex(HashBytes(0, bytes)), bytes);
  }

  Line line_;
  Random random_;
  const Subjects subjects_{"hall"};
  RoomCopy copy_{"hall"};
  Time now_;
  std::vector<PlainVolumeState> states_ = [] {
    std::vector<PlainVolumeState> states(2);
    for (auto& state : states) state.size = Vec3i(90, 70, 40);
    states[1].revision = 1000000;
    return states;
  }();
  std::vector<std::deque<std::pair<std::string, std::string>>> waiting_{2};  // of each publisher
  std::map<std::string, PlainVolumeState> published_;                        // by its message
  std::map<std::string, std::string> kept_;
  std::deque<std::pair<std::string, std::string>> live_, answers_;
  std::deque<std::string> asked_;
  std::string shown_;
  std::uint64_t shown_revision_ = 0;
  int shows_ = 0;
};

class Lines : public testing::TestWithParam<Line> {};
INSTANTIATE_TEST_SUITE_P(
    Some, Lines,
    testing::Values(Line{}, Line{.lost = 30}, Line{.damaged = 100},
                    Line{.lost = 20, .damaged = 50, .reordered = 100},
                    Line{.lost = 10, .damaged = 20, .reordered = 20, .two_publishers = true}));

TEST_P(Lines, OnlyWhatWasPublishedWholeIsShownAndTheNewestComesAfterwards) {
  int shows = 0;
  for (unsigned seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    Rig rig(GetParam(), seed);
    rig.Run(1500);
    shows += rig.shows();
    rig.Heal();
    if (HasFatalFailure() || HasFailure()) return;
  }
  EXPECT_GT(shows, 12);
}

// What the copy answers when everything that it asks for comes at once.
std::vector<RoomCopy::Shown> AnswerAll(RoomCopy& copy,
                                       const std::map<std::string, std::string>& kept,
                                       std::vector<std::string>* asked = nullptr) {
  std::vector<RoomCopy::Shown> shown;
  for (auto asks = copy.Asks(64); !asks.empty(); asks = copy.Asks(64)) {
    for (const std::string& subject : asks) {
      const auto found = kept.find(subject);
      const auto news = copy.TakeAnswer(subject, found == kept.end() ? "" : found->second, {});
      if (news.shown) shown.push_back(*news.shown);
      if (asked) asked->push_back(subject);
    }
  }
  return shown;
}

}  // namespace
}  // namespace palpate::web
