// The recorder between a pump and a disk that may be slow or full.
#include "server/recording/recorder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "server/recording/csv_export.h"
#include "server/recording/recorded_scenes.h"
#include "server/recording/recording_control.h"
#include "server/recording/recording_reader.h"
#include "tests/support/made_volume.h"
#include "tests/support/patience.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using test::Eventually;
using testing::MemoryOutput;
using testing::RandomSample;
using testing::ReadBytes;
using testing::Refusal;
using testing::SameSample;

// A disk that stops: Append waits while it is held, once the header is written.
class SlowOutput final : public MemoryOutput {
 public:
  using MemoryOutput::MemoryOutput;

  void Append(std::string_view bytes) override {
    std::unique_lock lock(mutex_);
    waiting_ = held_;
    changed_.notify_all();
    changed_.wait(lock, [&] { return !held_; });
    waiting_ = false;
    MemoryOutput::Append(bytes);
  }
  void Hold() {
    const std::lock_guard lock(mutex_);
    held_ = true;
  }
  void AwaitAppend() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return waiting_; });
  }
  void Release() {
    const std::lock_guard lock(mutex_);
    held_ = false;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool held_ = false;
  bool waiting_ = false;
};

// A disk that takes so long over each chunk that the ring is never empty: more ticks come
// meanwhile.
class LazyOutput final : public MemoryOutput {
 public:
  using MemoryOutput::MemoryOutput;
  void Append(std::string_view bytes) override {
    MemoryOutput::Append(bytes);
    for (int n = 0; recorder && n < 2000; ++n, ++sample.tick) recorder.load()->OnSample(sample);
  }
  std::atomic<Recorder*> recorder = nullptr;
  TickSample sample = RandomSample(1);
};

// A disk that is full after some bytes.
class FullOutput final : public MemoryOutput {
 public:
  using MemoryOutput::MemoryOutput;
  void Append(std::string_view bytes) override {
    if (written_ + bytes.size() > 600'000) throw Error(ErrorKind::kUnavailable, "disk full");
    written_ += bytes.size();
    MemoryOutput::Append(bytes);
  }

 private:
  std::size_t written_ = 0;
};

TickSample SampleOf(std::uint64_t tick, std::uint64_t scene_revision = 1) {
  TickSample sample = RandomSample(tick);
  sample.time_ns = static_cast<std::int64_t>(tick) * 1'000'000;
  sample.scene_revision = scene_revision;
  return sample;
}

// So many ticks make the writer write: a chunk, and the newest one, which waits for the next.
constexpr std::uint64_t kHeld = kSamplesPerChunk + 1;

struct Recorded {
  std::vector<TickSample> samples{};
  std::vector<RecordedScene> scenes{};
  std::vector<RecordedEvent> markers{};
  std::vector<RecordedGap> gaps{};
  bool complete = false;
};

Recorded ReadRecorded(const std::string& bytes) {
  RecordingReader reader = ReadBytes(bytes);
  const std::vector<RecordedItem> items = testing::ReadAll(reader);
  return {testing::SamplesIn(items), testing::Only<RecordedScene>(items),
          testing::Only<RecordedEvent>(items), testing::Only<RecordedGap>(items),
          reader.complete()};
}

class RecorderTest : public ::testing::Test {
 protected:
  void Feed(Recorder& recorder, std::uint64_t first, std::uint64_t end,
            std::uint64_t scene_revision = 1) {
    for (std::uint64_t tick = first; tick < end; ++tick) {
      recorder.OnSample(SampleOf(tick, scene_revision));
    }
  }
  static void AwaitTicks(const Recorder& recorder, std::uint64_t ticks) {
    EXPECT_TRUE(Eventually([&] { return recorder.report().counts.ticks >= ticks; }));
  }

  std::shared_ptr<std::string> bytes_ = std::make_shared<std::string>();
};

TEST_F(RecorderTest, RecordsEveryTickFromWhereverItStarts) {
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test");
  Feed(recorder, 5'000'000, 5'003'500);
  const RecorderReport report = recorder.Stop();
  EXPECT_EQ(report.counts.ticks, 3500u);
  EXPECT_EQ(report.counts.lost_ticks, 0u);
  EXPECT_EQ(report.counts.bytes, bytes_->size());
  EXPECT_FALSE(report.error);
  Feed(recorder, 5'003'500, 5'003'600);  // late ones are no part of it
  EXPECT_EQ(recorder.Stop().counts.ticks, 3500u);
  const Recorded recorded = ReadRecorded(*bytes_);
  ASSERT_EQ(recorded.samples.size(), 3500u);
  for (std::size_t n = 0; n < 3500; ++n) {
    ASSERT_TRUE(SameSample(recorded.samples[n], SampleOf(5'000'000 + n)));
  }
  EXPECT_TRUE(recorded.complete);
  EXPECT_TRUE(recorded.gaps.empty());
}

// A crash costs a second, however few ticks come in them. The newest tick waits for the next
// one.
TEST_F(RecorderTest, FewTicksAreWrittenAfterASecond) {
  std::atomic<std::int64_t> now_ms{1'000'000};
  std::atomic<int> looks{0};
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test", {}, {}, [&] {
    ++looks;
    return now_ms.load() * 1'000'000;
  });
  const auto await_looks = [&](int count) {
    EXPECT_TRUE(Eventually([&, before = looks.load()] { return looks >= before + count; }));
  };
  Feed(recorder, 100, 111);
  await_looks(2);  // they have come
  now_ms += 900;
  await_looks(3);
  EXPECT_EQ(recorder.report().counts.ticks, 0u);
  now_ms += 200;
  EXPECT_TRUE(Eventually([&] { return recorder.report().counts.ticks == 10; }));
}

TEST_F(RecorderTest, ScenesAndMarkersAreHeldToTheirTick) {
  std::atomic<std::int64_t> now_ns = SampleOf(149).time_ns;
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test", {}, {},
                    [&] { return now_ns.load(); });
  recorder.NoteScene({.scene_revision = 1, .isovalue = 0.1});
  Feed(recorder, 100, 150, 1);
  recorder.Mark("a");
  recorder.NoteScene({.scene_revision = 2, .isovalue = 0.2});  // no tick uses it
  recorder.NoteScene({.scene_revision = 3, .isovalue = 0.3});
  Feed(recorder, 150, 160, 1);
  Feed(recorder, 160, 170, 3);
  now_ns = SampleOf(169).time_ns;
  recorder.Mark("b");
  recorder.Stop();
  EXPECT_EQ(Refusal([&] { recorder.Mark("late"); }), ErrorKind::kUnavailable);

  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.samples.size(), 70u);
  ASSERT_EQ(recorded.scenes.size(), 2u);
  EXPECT_EQ(recorded.scenes[0].tick, 100u);
  EXPECT_EQ(recorded.scenes[0].isovalue, 0.1);
  EXPECT_EQ(recorded.scenes[1].tick, 160u);
  EXPECT_EQ(recorded.scenes[1].isovalue, 0.3);
  ASSERT_EQ(recorded.markers.size(), 2u);
  EXPECT_EQ(recorded.markers[0].tick, 149u);
  EXPECT_EQ(recorded.markers[0].marker, "a");
  EXPECT_EQ(recorded.markers[1].tick, 169u);
  EXPECT_TRUE(recorded.complete);
}

// Where the table, the timeline of a replay, and the markers themselves have each marker.
struct Places {
  std::vector<std::uint64_t> marker{}, table{}, outline{};
};

// The texts of the markers are their numbers.
Places PlacesOfMarkers(const std::string& bytes, std::uint64_t first_tick) {
  Places places;
  for (const RecordedEvent& marker : ReadRecorded(bytes).markers) {
    places.marker.push_back(marker.tick);
  }
  RecordingReader to_outline = ReadBytes(bytes);
  for (const RecordedMarker& marker : ReadOutline(to_outline, [] { return false; }).markers) {
    places.outline.push_back(first_tick + marker.tick);
  }
  RecordingReader to_table = ReadBytes(bytes);
  std::stringstream table;
  ExportCsv(to_table, table);
  places.table.resize(places.marker.size());
  for (std::string line; std::getline(table, line);) {
    std::istringstream texts(line.substr(line.rfind(',') + 1));
    for (std::string text; std::getline(texts, text, ';');) {
      if (text != "markers") places.table.at(std::stoul(text)) = std::stoul(line);
    }
  }
  return places;
}

// Samples come up to 50 ticks late. With and without a disk that stands still meanwhile.
TEST_F(RecorderTest, EveryMarkerStandsAtTheTickOfItsTime) {
  constexpr std::uint64_t kFirst = 70, kTicks = 3000, kMarkers = 300;
  for (const bool disk_stands : {false, true}) {
    std::mt19937_64 random(disk_stands);
    std::vector<TickSample> samples(kTicks);
    std::vector<std::int64_t> begins, times;
    for (std::uint64_t n = 0; n < kTicks; ++n) {
      const std::int64_t since_ns = 900'000 + random() % 200'000 + (random() % 50 == 0) * 3'000'000;
      begins.push_back(n == 0 ? 5'000'000 : begins.back() + since_ns);
      samples[n].tick = kFirst + n;
      samples[n].time_ns = begins.back();
    }
    for (std::uint64_t n = 0; n < kMarkers; ++n) {
      // At any time, at the very start of a tick, or in the tick of the marker before.
      const std::int64_t at_tick = begins[random() % kTicks];
      times.push_back(n % 3 == 0   ? at_tick
                      : n % 3 == 1 ? at_tick + static_cast<std::int64_t>(random() % 2'000'000)
                                   : times.back() + 1);
    }
    times.push_back(begins.front() - 1);
    std::sort(times.begin(), times.end());
    std::vector<std::uint64_t> ticks;
    for (const std::int64_t time_ns : times) {
      const auto next = std::upper_bound(begins.begin() + 1, begins.end(), time_ns);
      ticks.push_back(kFirst + static_cast<std::uint64_t>(next - begins.begin()) - 1);
    }

    bytes_ = std::make_shared<std::string>();
    std::atomic<std::int64_t> now_ns = 0;
    auto output = std::make_unique<SlowOutput>(bytes_);
    SlowOutput& disk = *output;
    Recorder recorder(std::move(output), "test", {}, {}, [&] { return now_ns.load(); });
    if (disk_stands) disk.Hold();
    std::uint64_t delivered = 0;
    for (std::size_t n = 0; n < times.size(); ++n) {
      const std::int64_t late_ns = random() % 50'000'000;
      while (delivered < kTicks && begins[delivered] + late_ns < times[n]) {
        recorder.OnSample(samples[delivered++]);
      }
      now_ns = times[n];
      EXPECT_EQ(recorder.Mark(std::to_string(n)), times[n]);
    }
    while (delivered < kTicks) recorder.OnSample(samples[delivered++]);
    disk.Release();
    EXPECT_EQ(recorder.Stop().counts.ticks, kTicks);
    const Places places = PlacesOfMarkers(*bytes_, kFirst);
    EXPECT_EQ(places.marker, ticks);
    EXPECT_EQ(places.table, ticks);
    EXPECT_EQ(places.outline, ticks);
  }
}

TEST_F(RecorderTest, TicksThatNeverCameAreAGap) {
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test");
  Feed(recorder, 0, 10);
  recorder.NoteScene({.scene_revision = 2});
  Feed(recorder, 15, 20, 2);
  EXPECT_EQ(recorder.Stop().counts.lost_ticks, 5u);
  const Recorded recorded = ReadRecorded(*bytes_);
  ASSERT_EQ(recorded.gaps.size(), 1u);
  EXPECT_EQ(recorded.gaps[0].first_tick, 10u);
  EXPECT_EQ(recorded.gaps[0].last_tick, 14u);
  ASSERT_EQ(recorded.scenes.size(), 1u);
  EXPECT_EQ(recorded.scenes[0].tick, 15u);
  EXPECT_TRUE(recorded.complete);
}

// The writer thread waits with kHeld ticks in its hands, the ring takes kQueueTicks more,
// and the rest is lost: no tick twice, none unaccounted for.
TEST_F(RecorderTest, ASlowDiskLosesTicksAndSaysSo) {
  constexpr std::uint64_t kRing = Recorder::kQueueTicks;
  constexpr std::int64_t kTickNs = 1'000'000;
  auto output = std::make_unique<SlowOutput>(bytes_);
  SlowOutput& disk = *output;
  // When no tick was recorded.
  Recorder recorder(std::move(output), "test", {}, {},
                    [] { return (kHeld + kRing + 9) * kTickNs; });
  disk.Hold();
  Feed(recorder, 0, kHeld);
  disk.AwaitAppend();
  Feed(recorder, kHeld, kHeld + kRing + 1234);
  recorder.Mark("while it stood still");
  EXPECT_EQ(recorder.report().counts.ticks, 0u);
  disk.Release();
  AwaitTicks(recorder, (1 + kRing / kSamplesPerChunk) * kSamplesPerChunk);
  constexpr std::uint64_t kSecond = kHeld + kRing + 1234;
  Feed(recorder, kSecond, kSecond + kHeld);
  // Lost at the end: declared, too.
  disk.Hold();
  Feed(recorder, kSecond + kHeld, kSecond + 2 * kHeld);
  disk.AwaitAppend();
  Feed(recorder, kSecond + 2 * kHeld, kSecond + 2 * kHeld + 2 * kRing);
  disk.Release();
  const RecorderReport report = recorder.Stop();

  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.samples.size(), report.counts.ticks);
  EXPECT_EQ(report.counts.ticks + report.counts.lost_ticks, kSecond + 2 * kHeld + 2 * kRing);
  ASSERT_EQ(recorded.gaps.size(), 2u);
  EXPECT_EQ(recorded.gaps[0].first_tick, kHeld + kRing);
  EXPECT_EQ(recorded.gaps[0].last_tick, kSecond - 1);
  EXPECT_EQ(recorded.gaps[1].last_tick, kSecond + 2 * kHeld + 2 * kRing - 1);
  ASSERT_EQ(recorded.markers.size(), 1u);
  EXPECT_EQ(recorded.markers[0].tick, kHeld + kRing - 1);
  EXPECT_TRUE(recorded.complete);
}

TEST_F(RecorderTest, StopIsHeardThoughTheRingIsNeverEmpty) {
  auto output = std::make_unique<LazyOutput>(bytes_);
  LazyOutput& disk = *output;
  Recorder recorder(std::move(output), "test");
  disk.sample.tick = kHeld;
  disk.recorder = &recorder;
  Feed(recorder, 0, kHeld);
  AwaitTicks(recorder, 2 * Recorder::kQueueTicks);
  const RecorderReport report = recorder.Stop();
  EXPECT_FALSE(report.error);
  EXPECT_GT(report.counts.lost_ticks, 0u);
  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.samples.size(), report.counts.ticks);
  EXPECT_TRUE(recorded.complete);
}

TEST_F(RecorderTest, WhatWaitsIsBounded) {
  auto output = std::make_unique<SlowOutput>(bytes_);
  SlowOutput& disk = *output;
  Recorder recorder(std::move(output), "test");
  disk.Hold();
  Feed(recorder, 0, kHeld);
  disk.AwaitAppend();
  for (std::size_t n = 0; n < Recorder::kMaxWaiting; ++n) recorder.Mark("m");
  EXPECT_EQ(Refusal([&] { recorder.Mark("m"); }), ErrorKind::kUnavailable);
  EXPECT_EQ(Refusal([&] { recorder.Mark(""); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(Refusal([&] { recorder.Mark(std::string(kMaxMarkerBytes + 1, 'x')); }),
            ErrorKind::kInvalidArgument);
  // The oldest scene makes room.
  for (std::size_t n = 0; n <= Recorder::kMaxWaiting; ++n) {
    recorder.NoteScene({.scene_revision = n + 2});
  }
  Feed(recorder, kHeld, kHeld + 1, 2);
  Feed(recorder, kHeld + 1, kHeld + 2, 3);
  disk.Release();
  recorder.Stop();
  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.markers.size(), Recorder::kMaxWaiting);
  ASSERT_EQ(recorded.scenes.size(), 1u);
  EXPECT_EQ(recorded.scenes[0].scene_revision, 3u);
}

TEST_F(RecorderTest, AFullDiskEndsTheRecordingAndKeepsWhatWasWritten) {
  Recorder recorder(std::make_unique<FullOutput>(bytes_), "test");
  Feed(recorder, 0, 4 * kSamplesPerChunk);
  EXPECT_TRUE(Eventually([&] { return recorder.report().error.has_value(); }));
  EXPECT_EQ(Refusal([&] { recorder.Mark("m"); }), ErrorKind::kUnavailable);
  const RecorderReport report = recorder.Stop();
  ASSERT_TRUE(report.error);
  EXPECT_EQ(report.error->kind(), ErrorKind::kUnavailable);
  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.samples.size(), report.counts.ticks);
  EXPECT_FALSE(recorded.complete);
}

// Where it begins, after each gap, and about one a second.
TEST_F(RecorderTest, KeyframesAreKeptWhereTheyAreNeeded) {
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test");
  const auto feed = [&](std::uint64_t first, std::uint64_t end) {
    for (std::uint64_t tick = first; tick < end; ++tick) {
      if (tick % kKeyframeTicks == 0) {
        ServoKeyframe keyframe{.tick = tick, .size = ServoKeyframe::kBytes};
        keyframe.bytes.front() = static_cast<char>(tick / kKeyframeTicks);
        recorder.OnKeyframe(keyframe);
      }
      recorder.OnSample(SampleOf(tick));
    }
  };
  feed(100, 4000);
  feed(4100, 4300);
  feed(4301, 4310);  // ends before the next one
  recorder.Stop();
  RecordingReader reader = ReadBytes(*bytes_);
  const std::vector<RecordedItem> all = testing::ReadAll(reader);
  std::vector<std::uint64_t> ticks;
  for (const RecordedKeyframe& keyframe : testing::Only<RecordedKeyframe>(all)) {
    ticks.push_back(keyframe.tick);
    EXPECT_EQ(keyframe.state.size(), ServoKeyframe::kBytes);
    EXPECT_EQ(keyframe.state.front(), static_cast<char>(keyframe.tick / kKeyframeTicks));
  }
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(ticks, (std::vector<std::uint64_t>{128, 1088, 2048, 3008, 3968, 4160}));
  EXPECT_EQ(testing::Only<RecordedSamples>(all).size(),
            1u + 4u + 1u + 2u + 1u);  // not one more than they part
}

// A disk that stands still, and edits all the while: what waits is let go, and all of
// it is in the next scene that is written.
TEST_F(RecorderTest, VoxelsThatWaitAreBounded) {
  auto output = std::make_unique<SlowOutput>(bytes_);
  SlowOutput& disk = *output;
  Recorder recorder(std::move(output), "test");
  disk.Hold();
  Feed(recorder, 0, kHeld);
  disk.AwaitAppend();
  const auto loaded = testing::MakeVolume({16, 16, 16}, [](int i, int, int) { return i; });
  std::vector<std::weak_ptr<const VolumeSnapshot>> volumes;
  auto volume = loaded;
  constexpr std::uint64_t kEdits = 20;
  constexpr std::uint64_t kBytesEach = Recorder::kMaxWaitingVoxelBytes / 5;
  for (std::uint64_t n = 2; n < 2 + kEdits; ++n) {
    const std::vector<BrickChange> change = {
        {Vec3i(0, n % 2, n / 2 % 2), testing::FilledLeaf(static_cast<float>(n))}};
    volume = testing::WithChanges(*volume, change);
    volumes.push_back(volume);
    recorder.NoteScene({.scene_revision = n,
                        .volume_revision = n,
                        .loaded_revision = 1,
                        .volume_hash = HashVolume(*volume)},
                       volume, kBytesEach);
    Feed(recorder, kHeld + n, kHeld + n + 1, n);
  }
  const VolumeHash last = HashVolume(*volume);
  volume.reset();
  const auto held = std::count_if(volumes.begin(), volumes.end(),
                                  [](const auto& weak) { return !weak.expired(); });
  EXPECT_LE(held, 5);
  EXPECT_GE(held, 4);
  disk.Release();
  EXPECT_FALSE(recorder.Stop().error);

  RecordingReader reader = ReadBytes(*bytes_);
  std::vector<RecordedEdit> edits;
  std::uint64_t missing = 0, scenes = 0;
  RecordedScene scene;
  auto replayed = loaded;
  while (const std::optional<RecordedItem> item = reader.Next()) {
    if (const auto* edit = std::get_if<RecordedEdit>(&*item)) edits.push_back(*edit);
    if (!std::holds_alternative<RecordedScene>(*item)) continue;
    scene = std::get<RecordedScene>(*item);
    ++scenes;
    missing += scene.voxels_missing;
    EXPECT_EQ(scene.voxels_missing, edits.empty());
    if (!edits.empty()) {
      replayed = WithEdits(*replayed, edits);
      EXPECT_EQ(HashVolume(*replayed), scene.volume_hash);
    }
    edits.clear();
  }
  EXPECT_EQ(scenes, kEdits);
  EXPECT_GE(missing, kEdits - 5);
  EXPECT_LT(missing, kEdits);
  EXPECT_EQ(HashVolume(*replayed), last);
}

// Nothing waits for a disk that failed.
TEST_F(RecorderTest, OneThatFailedLetsGoAndTakesNoMore) {
  auto output = std::make_unique<SlowOutput>(bytes_);
  SlowOutput& disk = *output;
  std::atomic<int> told = 0;
  Recorder recorder(std::move(output), "test", [&](const Error&) { ++told; });
  disk.Hold();
  Feed(recorder, 50, 50 + kHeld);
  disk.AwaitAppend();
  auto volume = testing::MakeVolume({16, 16, 16}, [](int i, int, int) { return i; });
  const std::weak_ptr<const VolumeSnapshot> held = volume;
  recorder.NoteScene({.scene_revision = 2}, volume, 0);
  Feed(recorder, 0, 2);  // the loop was restarted
  disk.Release();
  // Whoever is told finds it let go; the report says so earlier.
  EXPECT_TRUE(Eventually([&] { return told > 0; }));
  ASSERT_TRUE(recorder.report().error);
  EXPECT_EQ(recorder.report().error->kind(), ErrorKind::kInvalidArgument);
  recorder.NoteScene({.scene_revision = 3}, volume, 0);
  volume.reset();
  EXPECT_TRUE(held.expired());
  recorder.Stop();
  EXPECT_EQ(told, 1);
  EXPECT_EQ(ReadRecorded(*bytes_).samples.size(), kHeld);
}

// For ThreadSanitizer: all that may happen at once.
TEST_F(RecorderTest, ManyThreadsAtOnce) {
  constexpr std::uint64_t kTicks = 4000;
  Recorder recorder(std::make_unique<MemoryOutput>(bytes_), "test");
  std::thread pump([&] {
    for (std::uint64_t tick = 0; tick < kTicks; ++tick) {
      recorder.NoteScene({.scene_revision = tick + 1});
      recorder.OnSample(SampleOf(tick, tick + 1));
    }
  });
  std::thread client([&] {
    for (int n = 0; n < 100; ++n) {
      recorder.Mark("m");
      recorder.report();
    }
  });
  pump.join();
  client.join();
  std::thread other([&] { recorder.Stop(); });
  recorder.Stop();
  other.join();
  const Recorded recorded = ReadRecorded(*bytes_);
  EXPECT_EQ(recorded.samples.size(), kTicks);
  EXPECT_EQ(recorded.scenes.size(), kTicks);
  EXPECT_EQ(recorded.markers.size(), 100u);
  EXPECT_TRUE(recorded.complete);
}

}  // namespace
}  // namespace palpate
