// A room's copy, case by case: what it asks for, shows, drops and holds; its messages' bytes and
// subjects.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client/web/room/room_copy.h"
#include "client/web/room/room_protocol.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/zstd_codec.h"
#include "tests/support/plain_room.h"

namespace palpate::web {
namespace {

std::string ManifestText(const std::string& name) {
  return json{{"type", "manifest"}, {"name", name}}.dump();
}

// Of a volume of this name; "": there is no volume.
std::string RoomMessage(const std::string& volume, const std::string& manifest) {
  v1::RoomVolume room;
  if (!volume.empty()) room.mutable_facts()->mutable_volume()->set_name(volume);
  room.set_manifest(manifest);
  return room.SerializeAsString();
}

std::string VolumeMessage(const std::string& name, const std::string& volume) {
  return RoomMessage(volume, ManifestText(name));
}

// Settings of this revision, as a room keeps them.
std::string SettingsMessage(std::uint64_t revision) {
  v1::Envelope envelope;
  envelope.mutable_facts()->mutable_settings()->set_settings_revision(revision);
  return envelope.SerializeAsString();
}

class RoomCopies : public testing::Test {
 protected:
  RoomCopies() {
    state_.size = {90, 90, 40};
    state_ = Edited(state_, random_);
  }
  Messages Publish() {
    const PlainVolumeState before = std::exchange(state_, Edited(state_, random_));
    const Messages messages = MessagesOf(state_, before, subjects_, random_);
    for (const auto& [subject, bytes] : messages) kept_[subject] = bytes;
    return messages;
  }
  // All groups are published.
  void Begin() {
    PlainVolumeState none;
    for (const auto& [subject, bytes] : MessagesOf(state_, none, subjects_, random_)) {
      kept_[subject] = bytes;
    }
  }
  // The copy shows a volume of an overview alone. Returns its manifest's name.
  std::string Show() {
    Manifest alone;
    alone.size = {9, 9, 9};
    alone.overview = HashOf(HashBytes(0, "x"));
    alone.overview_size = {1, 1, 1};
    const std::string text = ToJson(alone), hash = HashBytes(255, text);
    copy_.TakeLive(subjects_.overview(0), PlainParts(0, HashBytes(0, "x"), Zip("x"), 1)[0], {});
    copy_.TakeLive(subjects_.manifest(0), PlainParts(255, hash, Zip(text), 1)[0], {});
    EXPECT_TRUE(Take(VolumeMessage(Hex(hash), "shown")));
    return Hex(hash);
  }
  std::optional<RoomCopy::Shown> Take(const std::string& volume_message) {
    return copy_.TakeLive(subjects_.volume(), volume_message, {}).shown;
  }

  Random random_{5};
  const Subjects subjects_{"r"};
  PlainVolumeState state_;
  std::map<std::string, std::string> kept_;
  RoomCopy copy_{"r"};
};

TEST_F(RoomCopies, AsksForEachMessageOnceAndThenForNothing) {
  Begin();
  EXPECT_FALSE(copy_.is_complete());
  std::vector<std::string> asked;
  const auto shown = AnswerAll(copy_, kept_, &asked);
  ASSERT_EQ(shown.size(), 1U);
  EXPECT_TRUE(copy_.is_complete());
  std::set<std::string> expected;
  for (const Topic topic : kTextTopics) expected.insert(subjects_.text(topic));
  for (const auto& [subject, bytes] : kept_) {
    if (bytes != BackgroundPart()) expected.insert(subject);
  }
  EXPECT_EQ(asked.size(), expected.size());
  EXPECT_EQ(std::set<std::string>(asked.begin(), asked.end()), expected);
  for (int n = 0; n < 50; ++n) {
    int shows = 0;
    for (const auto& [subject, bytes] : Publish()) {
      shows += copy_.TakeLive(subject, bytes, {}).shown ? 1 : 0;
      EXPECT_TRUE(copy_.Asks(64).empty()) << subject;
      EXPECT_EQ(copy_.missing_groups(), 0U);
    }
    EXPECT_EQ(shows, 1);
    EXPECT_TRUE(copy_.is_complete());
  }
}

TEST_F(RoomCopies, WhileGroupsAreSupersededTheNextVolumeIsCompleteWhenItComes) {
  Begin();
  for (const std::string& subject : copy_.Asks(64)) copy_.TakeAnswer(subject, kept_[subject], {});
  const auto groups = copy_.Asks(3);
  ASSERT_FALSE(groups.empty());
  for (int n = 0; n < 4; ++n) {  // answers bring groups that no manifest here names yet
    const Messages messages = Publish();
    AnswerAll(copy_, kept_);
    for (const auto& [subject, bytes] : messages) copy_.TakeLive(subject, bytes, {});
  }
  for (const std::string& subject : groups) copy_.TakeAnswer(subject, kept_[subject], {});
  for (const auto& [subject, bytes] : Publish()) copy_.TakeLive(subject, bytes, {});
  EXPECT_TRUE(copy_.is_complete());
}

TEST_F(RoomCopies, ATextThatCameLiveIsNotReplacedByAnOlderAnswer) {
  const std::string subject = subjects_.text(Topic::kSettings);
  const std::string old = SettingsMessage(1), next = SettingsMessage(2);
  EXPECT_TRUE(copy_.TakeAnswer(subject, old, {}).texts.empty()) << "nobody asked";
  copy_.Asks(64);
  const auto live = copy_.TakeLive(subject, next, {});
  ASSERT_EQ(live.texts.size(), 1U);
  EXPECT_EQ(live.texts[0], std::pair(Topic::kSettings, next));
  EXPECT_TRUE(copy_.TakeAnswer(subject, old, {}).texts.empty());
  copy_.AskAnew(true);
  copy_.Asks(64);
  EXPECT_EQ(copy_.TakeAnswer(subject, next, {}).texts.size(), 1U);

  const std::string name = Show();
  EXPECT_FALSE(copy_.TakeAnswer(subjects_.volume(), VolumeMessage(name, "old"), {}).shown);
}

// What a publisher's beat names of these texts and this volume's message.
using Named = std::map<std::string, std::string>;
std::string NameIn(const std::string& subject, const std::string& message) {
  return Hex(HashBytes(1, subject + '\0' + message));
}

TEST_F(RoomCopies, WhatABeatNamesAndDidNotComeIsAskedForAnew) {
  const std::string settings = subjects_.text(Topic::kSettings), volume = subjects_.volume();
  const std::string first = SettingsMessage(1), second = SettingsMessage(2);
  Time now{std::chrono::hours(1)};
  const auto beat = [&](const Named& named) {
    return copy_.TakeBeat(named, now += std::chrono::milliseconds(500));
  };
  AnswerAll(copy_, {{settings, first}, {volume, "bad"}});
  // Only what it names is compared: a session that has put nothing yet names nothing.
  for (const Named& named :
       {Named{}, Named{{"settings", NameIn(settings, first)}},
        Named{{"settings", NameIn(settings, first)}, {"volume", NameIn(volume, "bad")}},
        Named{{"another", "?"}}}) {
    for (int n = 0; n < 9; ++n) EXPECT_FALSE(beat(named));
  }
  EXPECT_TRUE(copy_.Asks(64).empty());
  // One beat may come before the message.
  const Named next{{"settings", NameIn(settings, second)}, {"volume", NameIn(volume, "bad")}};
  EXPECT_FALSE(beat(next));
  copy_.TakeLive(settings, second, now);
  EXPECT_FALSE(beat(next));
  EXPECT_TRUE(copy_.Asks(64).empty());
  const std::string series = subjects_.text(Topic::kSeries);
  for (const auto& [name, subject] : {std::pair("settings", settings), std::pair("series", series),
                                      std::pair("volume", volume)}) {
    const Named lost{{name, NameIn(subject, "x")}};
    now += std::chrono::seconds(60);
    EXPECT_FALSE(beat(lost));
    EXPECT_TRUE(beat(lost));
    // Nothing else: a long copy's groups are under way, and texts come behind them.
    EXPECT_EQ(copy_.Asks(64), std::vector{subject});
  }
}

TEST_F(RoomCopies, WhatNeverComesIsAskedForEverMoreSeldom) {
  const std::string settings = subjects_.text(Topic::kSettings), text = SettingsMessage(3);
  const Named lost{{"settings", NameIn(settings, text)}};
  const Time start{std::chrono::hours(1)};
  std::vector<double> waits;
  Time now = start, last = start;
  for (; now < start + std::chrono::minutes(6); now += std::chrono::milliseconds(500)) {
    if (!copy_.TakeBeat(lost, now)) continue;
    waits.push_back(std::chrono::duration<double>(now - last).count());
    last = now;
    AnswerAll(copy_, {});
  }
  EXPECT_EQ(waits, (std::vector<double>{0.5, 2, 4, 8, 16, 32, 60, 60, 60, 60}));
  // It came: the next loss is asked for soon.
  copy_.TakeLive(settings, text, now);
  EXPECT_FALSE(copy_.TakeBeat(lost, now));
  copy_.TakeLive(settings, SettingsMessage(1), now);
  EXPECT_FALSE(copy_.TakeBeat(lost, now));
  EXPECT_TRUE(copy_.TakeBeat(lost, last + std::chrono::seconds(2)));
}

TEST_F(RoomCopies, AnotherTextOfTheShownManifestIsShownAtOnce) {
  const std::string name = Show();
  const auto shown = Take(VolumeMessage(name, "renamed"));
  ASSERT_TRUE(shown);
  v1::Envelope volume;
  ASSERT_TRUE(volume.ParseFromString(shown->volume));
  EXPECT_EQ(volume.facts().volume().name(), "renamed");
  EXPECT_TRUE(copy_.Find(name));
}

// Else guests read of one volume and see the voxels of another.
TEST_F(RoomCopies, AVolumeWithoutAManifestIsDropped) {
  const std::string message = RoomMessage("another", "");
  EXPECT_FALSE(Take(message));
  const std::string name = Show();
  EXPECT_FALSE(Take(message));
  // One that waits for its voxels still comes.
  Begin();
  EXPECT_FALSE(Take(state_.message));
  EXPECT_FALSE(Take(message));
  EXPECT_EQ(AnswerAll(copy_, kept_).size(), 1U);
  EXPECT_TRUE(copy_.Find(state_.name));
}

TEST_F(RoomCopies, BadTextsAreDropped) {
  const std::string name = Show(), good = VolumeMessage(name, "x");
  const std::string bad[] = {"",
                             "\xff\xfe",
                             std::string(100000, '['),
                             good.substr(0, good.size() - 1),
                             RoomMessage("", ManifestText(name)),
                             RoomMessage("x", R"({"type":"manifest"})"),
                             RoomMessage("x", R"({"type":"manifest","name":5})"),
                             RoomMessage("x", ManifestText("xyz")),
                             RoomMessage("x", ManifestText(std::string(32, '0'))),
                             RoomMessage(std::string(1 << 20, 'a'), ManifestText(name)),
                             SettingsMessage(1)};
  for (const std::string& text : bad) {
    EXPECT_FALSE(Take(text)) << text.substr(0, 90);
    EXPECT_TRUE(copy_.TakeLive(subjects_.text(Topic::kSeries), text, {}).texts.empty());
  }
  EXPECT_TRUE(Take(good));
  EXPECT_TRUE(
      copy_.TakeLive("palpate.other.kept.text.settings", SettingsMessage(1), {}).texts.empty());
}

// A frame that zstd skips.
std::string Skipped(std::size_t bytes) {
  std::string frame{0x50, 0x2a, 0x4d, 0x18};
  for (int n = 0; n < 4; ++n) frame += static_cast<char>(bytes >> 8 * n & 255);
  return frame + std::string(bytes, 's');
}

TEST_F(RoomCopies, FalseBlobsAreNotHeld) {
  const std::string group = RandomGroup(random_), hash = HashBytes(0, group), zstd = Zip(group);
  const std::string bomb(std::size_t{65} << 20, 'a'), small(9, 'a');
  const auto part = [](unsigned char kind, const std::string& name, const std::string& bytes) {
    return PlainParts(kind, name, bytes, 1)[0];
  };
  const std::string false_groups[] = {part(0, hash, Zip(RandomGroup(random_))),  // other bytes
                                      part(1, hash, zstd),                       // another kind
                                      part(255, HashBytes(255, group), zstd),    // a manifest
                                      part(0, hash, zstd.substr(0, zstd.size() / 2)),
                                      part(0, hash, zstd + "x"),
                                      part(0, hash, zstd + Skipped(400000)),
                                      part(0, hash, Skipped(400000) + zstd),
                                      part(0, hash, group),
                                      part(0, HashBytes(0, small), Zip(small)),  // no 32^3 voxels
                                      part(0, HashBytes(0, bomb), Zip(bomb)),
                                      PlainParts(0, hash, zstd, 2)[0],
                                      "\2" + part(0, hash, zstd).substr(1),
                                      part(0, std::string(16, '\0'), zstd)};
  for (const std::string& bytes : false_groups) {
    copy_.TakeLive(subjects_.group(0), bytes, {});
    EXPECT_EQ(copy_.shelf().size(), 0U);
  }
  copy_.TakeLive(subjects_.group(RoomCopy::kMostGroups), part(0, hash, zstd), {});
  copy_.TakeLive(subjects_.overview(0), part(0, HashBytes(0, bomb), Zip(bomb)), {});
  copy_.TakeLive(subjects_.overview(0), part(255, HashBytes(255, group), zstd), {});
  copy_.TakeLive(subjects_.overview(0), part(0, hash, zstd + Skipped(400000)), {});
  copy_.TakeLive(subjects_.manifest(0), part(255, HashBytes(255, "{}"), Zip("{}")), {});
  copy_.TakeLive(subjects_.manifest(0), part(0, hash, zstd), {});
  EXPECT_EQ(copy_.shelf().size(), 0U);
  copy_.TakeLive(subjects_.group(0), part(0, hash, zstd), {});
  EXPECT_TRUE(copy_.Find(Hex(hash)));
}

TEST_F(RoomCopies, PartsOfTwoCompressionsOfOneBlobAreNotMixed) {
  const std::string bytes(5000, 'a'), hash = HashBytes(0, bytes), one = Zip(bytes);
  const std::string other = one.substr(0, 4) + "???" + one.substr(7);
  const auto good = PlainParts(0, hash, one, 2), mixed = PlainParts(0, hash, other, 2);
  copy_.TakeLive(subjects_.overview(0), mixed[0], {});
  copy_.TakeLive(subjects_.overview(1), good[1], {});
  EXPECT_FALSE(copy_.Find(Hex(hash)));
  copy_.TakeLive(subjects_.overview(0), good[0], {});
  copy_.TakeLive(subjects_.overview(1), good[1], {});
  EXPECT_TRUE(copy_.Find(Hex(hash)));
}

TEST_F(RoomCopies, AnswersOfOlderBlobsDoNotReplaceNewerOnes) {
  const std::string old = RandomGroup(random_), next = RandomGroup(random_);
  const auto was = PlainParts(0, HashBytes(0, old), Zip(old), 2);
  const auto is = PlainParts(0, HashBytes(0, next), Zip(next), 2);
  copy_.Asks(64);
  copy_.TakeAnswer(subjects_.overview(0), was[0], {});
  EXPECT_EQ(copy_.Asks(64), std::vector<std::string>{subjects_.overview(1)});
  copy_.TakeLive(subjects_.overview(0), is[0], {});
  copy_.TakeAnswer(subjects_.overview(1), was[1], {});
  copy_.TakeLive(subjects_.overview(1), is[1], {});
  EXPECT_TRUE(copy_.Find(Hex(HashBytes(0, next))));

  const std::string third = RandomGroup(random_);
  copy_.TakeLive(subjects_.group(0), PlainParts(0, HashBytes(0, third), Zip(third), 1)[0], {});
  copy_.TakeAnswer(subjects_.group(0), PlainParts(0, HashBytes(0, old), Zip(old), 1)[0], {});
  EXPECT_FALSE(copy_.Find(Hex(HashBytes(0, old))));
}

TEST(Parts, AreThoseOfTheTable) {
  Random random(8);
  std::string zstd(2 * kMostSlice + 1, '\0');
  for (char& c : zstd) c = static_cast<char>(random());
  const std::string name = HashBytes(3, "name");
  const auto parts = PartsOf(3, HashOf(name), zstd);
  ASSERT_EQ(parts.size(), 3U);
  std::string whole;
  for (std::size_t n = 0; n < 3; ++n) {
    const std::string header{1, 3, static_cast<char>(n), 0, 3, 0};
    EXPECT_EQ(parts[n].substr(0, 22), header + name);
    const auto part = DecodePart(parts[n]);
    ASSERT_TRUE(part);
    EXPECT_EQ(part->number, n);
    EXPECT_EQ(NameOf(part->hash), Hex(name));
    whole += part->slice;
  }
  EXPECT_EQ(whole, zstd);
  EXPECT_EQ(BackgroundPart(), std::string({1, 0, 0, 0, 1, 0}) + std::string(16, '\0'));
  EXPECT_ANY_THROW(PartsOf(0, HashOf(name), std::string((kMostParts + 1) * kMostSlice, 'a')));
  std::string bad = parts[0];
  for (const auto& [at, value] :
       {std::pair(0, 0), {0, 2}, {1, 4}, {1, 254}, {2, 3}, {4, 0}, {5, 1}}) {
    bad = parts[0];
    bad[static_cast<std::size_t>(at)] = static_cast<char>(value);
    EXPECT_FALSE(DecodePart(bad)) << at << " " << value;
  }
  for (const std::size_t size : {0, 1, 21, 22}) EXPECT_FALSE(DecodePart(parts[0].substr(0, size)));
  EXPECT_FALSE(DecodePart(parts[0] + "x")) << "too long";
}

TEST(RoomSubjects, AreReadBack) {
  const Subjects subjects("hall-1");
  EXPECT_EQ(subjects.group(17), "palpate.hall-1.kept.group.17");
  EXPECT_EQ(subjects.text(Topic::kSeries), "palpate.hall-1.kept.text.series");
  EXPECT_EQ(subjects.direct_get(subjects.volume()),
            "$JS.API.DIRECT.GET.PALPATE_hall-1.palpate.hall-1.kept.volume");
  std::vector<Kept> all{{.kind = Kept::Kind::kVolume}};
  for (const Topic topic : kTextTopics) all.push_back({.topic = topic});
  for (const auto kind : {Kept::Kind::kManifest, Kept::Kind::kOverview, Kept::Kind::kGroup}) {
    for (const std::uint32_t number : {0U, 7U, 4294967295U}) {
      all.push_back({.kind = kind, .number = number});
    }
  }
  for (const Kept& kept : all) {
    const std::string subject = subjects.SubjectOf(kept);
    EXPECT_EQ(subjects.ParseKept(subject), kept) << subject;
    EXPECT_FALSE(Subjects("hall").ParseKept(subject)) << subject;
  }
  for (const char* const wrong :
       {"", "group.", "group.01", "group.-1", "group.+1", "group.4294967296", "group.1.2",
        "volume.", "text.", "text.guests", "text.placement", "text.volume", "manifest", "other.1",
        "1"}) {
    EXPECT_FALSE(subjects.ParseKept(std::string("palpate.hall-1.kept.") + wrong)) << wrong;
  }
  EXPECT_EQ(subjects.ParseSteer(subjects.steer("Site_2")), "Site_2");
  for (const char* const wrong : {"palpate.hall-1.steer.", "palpate.hall-1.steer.a.b",
                                  "palpate.hall.steer.a", "palpate.hall-1.kept.volume"}) {
    EXPECT_FALSE(subjects.ParseSteer(wrong)) << wrong;
  }
}

TEST(RoomSubjects, NamesAreSingleTokens) {
  EXPECT_TRUE(IsRoom("a") && IsRoom("hall_2-x") && IsRoom(std::string(32, 'a')));
  EXPECT_TRUE(IsNatsUser("Site-2_x") && IsNatsUser(std::string(64, 'A')));
  for (const std::string& wrong :
       {std::string(), std::string("a.b"), std::string("*"), std::string(">"), std::string("a b"),
        std::string("\xc3\xa4"), std::string("a\0", 2), std::string(65, 'a')}) {
    EXPECT_FALSE(IsRoom(wrong) || IsNatsUser(wrong)) << wrong;
    EXPECT_ANY_THROW(Subjects{wrong});
  }
  EXPECT_FALSE(IsRoom("Hall") || IsRoom(std::string(33, 'a')));
}

// Prints what a large volume costs; judges only that it is shown.
TEST(RoomCopyCost, OfALargeVolume) {
  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  };
  Random random(3);
  const Subjects subjects("r");
  PlainVolumeState state;
  state.size = Vec3i::Constant(512);
  // As noisy scans: incompressible.
  std::string noise(std::size_t{1} << 20, '\0');
  for (char& c : noise) c = static_cast<char>(random());
  const auto draw = [&] {
    return noise.substr(random() % (noise.size() - kGroupBytes), kGroupBytes);
  };
  for (std::uint32_t n = 0; n < 4096; ++n) state.groups[n] = draw();
  state.overview = "overview";
  state.Make();
  std::map<std::string, std::string> kept;
  for (const auto& [subject, bytes] : MessagesOf(state, {}, subjects, random)) {
    kept[subject] = bytes;
  }
  RoomCopy copy("r");
  auto start = Clock::now();
  EXPECT_EQ(AnswerAll(copy, kept).size(), 1U);
  std::printf("join of 4096 groups of 32 KiB: %.0f ms\n", since(start));

  double total = 0.0, last = 0.0;
  constexpr int kStates = 5;
  for (int n = 0; n < kStates; ++n) {
    const PlainVolumeState before = state;
    for (int m = 0; m < 200; ++m) state.groups[random() % 4096] = draw();
    ++state.revision;
    state.Make();
    bool is_shown = false;
    for (const auto& [subject, bytes] : MessagesOf(state, before, subjects, random)) {
      start = Clock::now();
      is_shown = copy.TakeLive(subject, bytes, {}).shown.has_value();
      total += since(start);
      if (is_shown) last += since(start);
    }
    EXPECT_TRUE(is_shown);
  }
  std::printf(
      "200 changed groups and their manifest: %.2f ms, of it the volume's message %.2f ms\n",
      total / kStates, last / kStates);
}

}  // namespace
}  // namespace palpate::web
