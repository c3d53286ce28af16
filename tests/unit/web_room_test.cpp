// A room's copy against a simple model of the room: publishers, a server that keeps the newest
// message of each subject, and a line that loses, damages, delays and invents messages. Whatever
// comes, each volume that is shown is one that was published whole, and every blob that it names is
// there with its bytes.
#include <gtest/gtest.h>
#include <xxhash.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "client/web/nats/room_copy.h"
#include "client/web/volume/blob_name.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/zstd_codec.h"

namespace palpate::web {
namespace {

using nlohmann::json;
using Random = std::mt19937;
using Time = RoomCopy::Time;

constexpr std::size_t kGroupBytes = std::size_t{32} * 32 * 32;  // of uint8

std::string Zip(const std::string& bytes) { return CompressBytes(std::as_bytes(std::span(bytes))); }

// The 16 bytes of a name, most significant first.
std::string HashBytes(unsigned char kind, const std::string& bytes) {
  const std::string all = std::string(1, static_cast<char>(kind)) + bytes;
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits(all.data(), all.size()));
  return {reinterpret_cast<const char*>(canonical.digest), 16};
}

std::string Hex(const std::string& bytes) {
  std::string hex;
  for (const char c : bytes) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", static_cast<unsigned char>(c));
    hex += two;
  }
  return hex;
}

// By the table of part.h, in as many parts as wanted.
std::vector<std::string> PlainParts(unsigned char kind, const std::string& hash,
                                    const std::string& zstd, std::size_t count) {
  std::vector<std::string> parts;
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t first = zstd.size() * n / count;
    std::string part{1, static_cast<char>(kind)};
    for (const std::size_t value : {n, count}) {
      part += static_cast<char>(value & 255);
      part += static_cast<char>(value >> 8);
    }
    parts.push_back(part + hash + zstd.substr(first, zstd.size() * (n + 1) / count - first));
  }
  return parts;
}

using Messages = std::vector<std::pair<std::string, std::string>>;

// One state of a volume, as a publisher has it.
struct PlainVolumeState {
  Vec3i size = Vec3i::Zero();
  std::map<std::uint32_t, std::string> groups;  // by number; absent: background
  std::string overview;
  std::uint64_t revision = 0;
  // Made of these.
  std::string manifest, name, message;

  std::uint32_t count() const {
    const Vec3i groups = (size + Vec3i::Constant(31)) / 32;
    return static_cast<std::uint32_t>(groups.prod());
  }

  void Make() {
    Manifest made{.size = size,
                  .type = LeafType::kUint8,
                  .value_max = 255.0,
                  .revision = {.daemon_id = 7, .volume_revision = revision},
                  .overview = HashOf(HashBytes(0, overview)),
                  .overview_size = Vec3i::Ones(),
                  .groups = std::vector<ContentHash>(count())};
    for (const auto& [number, bytes] : groups) made.groups[number] = HashOf(HashBytes(0, bytes));
    manifest = ToJson(made);
    name = Hex(HashBytes(255, manifest));
    message = json{{"volume", json{{"type", "volume"}, {"revision", revision}}.dump()},
                   {"placement", R"({"type":"placement"})"},
                   {"manifest", json{{"type", "manifest"}, {"name", name}}.dump()}}
                  .dump();
  }
};

std::string RandomGroup(Random& random) {
  std::string bytes(kGroupBytes, static_cast<char>(random() % 256));
  for (int n = 0; n < 9; ++n) bytes[random() % bytes.size()] = static_cast<char>(random());
  return bytes;
}

PlainVolumeState Edited(PlainVolumeState state, Random& random) {
  if (random() % 12 == 0) {
    for (int& axis : state.size) axis = 1 + static_cast<int>(random() % 90);
    state.groups.clear();
  }
  for (std::uint32_t n = 0, edits = 1 + random() % 6; n < edits; ++n) {
    const std::uint32_t number = random() % state.count();
    if (random() % 4 == 0) {
      state.groups.erase(number);
    } else {
      state.groups[number] = RandomGroup(random);
    }
  }
  state.overview = RandomGroup(random);
  ++state.revision;
  state.Make();
  return state;
}

// What a publisher that knows what the room keeps sends for a new state.
Messages MessagesOf(const PlainVolumeState& state, const PlainVolumeState& before,
                    const Subjects& subjects, Random& random) {
  Messages messages;
  const std::uint32_t count = std::max(state.count(), before.count());
  for (std::uint32_t n = 0; n < count; ++n) {
    const auto is = state.groups.find(n), was = before.groups.find(n);
    if (is == state.groups.end()) {
      if (was != before.groups.end()) messages.emplace_back(subjects.group(n), BackgroundPart());
    } else if (was == before.groups.end() || was->second != is->second) {
      const std::string& bytes = is->second;
      messages.emplace_back(subjects.group(n),
                            PlainParts(0, HashBytes(0, bytes), Zip(bytes), 1)[0]);
    }
  }
  std::shuffle(messages.begin(), messages.end(), random);
  const auto add = [&](bool is_manifest, const std::string& bytes) {
    const unsigned char kind = is_manifest ? 255 : 0;
    const auto parts = PlainParts(kind, HashBytes(kind, bytes), Zip(bytes), 1 + random() % 4);
    for (std::uint32_t n = 0; n < parts.size(); ++n) {
      messages.emplace_back(is_manifest ? subjects.manifest(n) : subjects.overview(n), parts[n]);
    }
  };
  add(false, state.overview);
  add(true, state.manifest);
  messages.emplace_back(subjects.volume(), state.message);
  return messages;
}

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
  }

  int shows() const { return shows_; }
  std::uint64_t newest_published() const { return newest_; }
  std::uint64_t newest_shown() const { return shown_revision_; }

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
    if (message.first == subjects_.volume()) ++newest_;
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
    while (asked_.size() + answers_.size() < 16) {
      const auto asks = copy_.Asks(16 - asked_.size() - answers_.size());
      asked_.insert(asked_.end(), asks.begin(), asks.end());
      if (asks.empty()) break;
    }
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
    shown_ =
        json{{"volume", shown.volume}, {"placement", shown.placement}, {"manifest", shown.manifest}}
            .dump();
    const auto found = published_.find(shown_);
    ASSERT_NE(found, published_.end()) << "texts that were never published together";
    ASSERT_TRUE(shown.has_groups);
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
  std::uint64_t newest_ = 0, shown_revision_ = 0;
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
  for (unsigned seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    Rig rig(GetParam(), seed);
    rig.Run(1500);
    shows += rig.shows();
    rig.Heal();
    if (HasFatalFailure() || HasFailure()) return;
  }
  EXPECT_GT(shows, 12);
}

}  // namespace
}  // namespace palpate::web
