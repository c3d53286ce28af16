// Recorded samples: as tables, as paths of a stylus, and in place of live ones.
#include <gtest/gtest.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/recording/csv_export.h"
#include "server/recording/recorded_path.h"
#include "server/recording/recording_writer.h"
#include "server/recording/viewer_replay.h"
#include "server/recording/volume_hash.h"
#include "server/simulated_hand/replay_device.h"
#include "tests/support/made_volume.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using testing::MakeVolume;
using testing::MemoryOutput;
using testing::RandomSample;
using testing::ReadBytes;
using testing::Refusal;

std::vector<std::string> Split(const std::string& text, char at) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, at);) parts.push_back(part);
  return parts;
}

std::size_t Column(const std::string& header, const std::string& name) {
  const std::vector<std::string> names = Split(header, ',');
  return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
}

std::string Record(const std::function<void(RecordingWriter&)>& write, bool end = true) {
  auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test");
  write(writer);
  if (end) writer.AppendEnd();
  return *bytes;
}

std::string Record(const std::vector<TickSample>& samples, bool end = true) {
  return Record([&](RecordingWriter& writer) { testing::Append(writer, samples); }, end);
}

std::string Table(const std::string& bytes) {
  RecordingReader reader = ReadBytes(bytes);
  std::ostringstream table;
  ExportCsv(reader, table);
  EXPECT_TRUE(reader.complete());
  return table.str();
}

// Of a stylus whose x is the number of the tick.
TickSample Sample(std::uint64_t tick, std::uint64_t missed = 0) {
  TickSample sample;
  sample.tick = tick;
  sample.missed_ticks = missed;
  sample.hip_mm = {static_cast<double>(tick), 2.0, 3.0};
  return sample;
}

TEST(CsvExport, NumbersReadBackBitForBit) {
  const std::vector<TickSample> samples = testing::RandomSamples(40, 500);
  const std::vector<std::string> lines = Split(Table(Record(samples)), '\n');
  ASSERT_EQ(lines.size(), 501u);
  const std::size_t force = Column(lines[0], "force_y_n"), mode = Column(lines[0], "mode");
  const std::size_t columns = Split(lines[0], ',').size();
  EXPECT_EQ(Split(lines[0], ',').back(), "markers");
  for (std::size_t n = 0; n < 500; ++n) {
    const std::vector<std::string> fields = Split(lines[n + 1] + ".", ',');
    ASSERT_EQ(fields.size(), columns);
    EXPECT_EQ(fields[0], std::to_string(40 + n));
    const std::string& text = fields[force];
    double read = 0.0;
    std::from_chars(text.data(), text.data() + text.size(), read);
    const double recorded = samples[n].force_n[1];
    EXPECT_TRUE(read == recorded || (std::isnan(read) && std::isnan(recorded))) << text;
    EXPECT_EQ(fields[mode] == "ejecting", samples[n].mode == ProxyMode::kEjecting);
  }
}

TEST(CsvExport, TicksOfSeveralHandsAreRefused) {
  TickSample sample;
  sample.hand = 1;
  const std::string bytes =
      Record([&](RecordingWriter& writer) { testing::Append(writer, std::vector{sample}); });
  RecordingReader reader = ReadBytes(bytes);
  std::ostringstream table;
  ExportCsv(reader, table);
  EXPECT_FALSE(reader.complete());
  EXPECT_EQ(Split(table.str(), '\n').size(), 1u);
}

TEST(CsvExport, MarkersStandOnTheirTick) {
  const std::string bytes = Record([](RecordingWriter& writer) {
    const auto append = [&](std::uint64_t tick) {
      TickSample sample;
      sample.tick = tick;
      sample.time_ns = 100 * static_cast<std::int64_t>(tick);
      testing::Append(writer, std::vector{sample});
    };
    append(0);
    writer.Append(RecordedEvent{.tick = 1, .marker = "trial \"7\""});
    append(1);
    writer.Append(RecordedEvent{.tick = 2, .marker = "left"});
    writer.Append(RecordedEvent{.tick = 2, .marker = "end, of it"});
    append(2);
  });
  const std::vector<std::string> lines = Split(Table(bytes), '\n');
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(Split(lines[1] + ".", ',').back(), ".");
  EXPECT_TRUE(lines[2].ends_with(",\"trial \"\"7\"\"\""));
  EXPECT_TRUE(lines[3].ends_with(",\"left; end, of it\""));
}

TEST(CsvExport, EachRowCountsTheTicksThatAreNotRecorded) {
  const std::vector<TickSample> samples = {Sample(5), Sample(6), Sample(9), Sample(10), Sample(20)};
  std::ostringstream of_memory;
  ExportCsv(samples, of_memory);
  const std::string recorded = Record([&](RecordingWriter& writer) {
    for (const TickSample& sample : samples) {
      writer.SkipTo(sample.tick);
      testing::Append(writer, std::vector{sample});
    }
  });
  for (const std::string& table : {Table(recorded), of_memory.str()}) {
    std::vector<std::string> lines = Split(table, '\n'), lost;
    for (const std::string& line : lines) {
      lost.push_back(Split(line, ',').at(Column(lines[0], "lost_ticks")));
    }
    EXPECT_EQ(lost, (std::vector<std::string>{"lost_ticks", "0", "0", "2", "2", "11"}));
  }
}

TEST(CsvExport, AFullStreamIsAnError) {
  RecordingReader reader = ReadBytes(Record([](RecordingWriter&) {}));
  std::ostringstream table;
  table.setstate(std::ios::badbit);
  EXPECT_EQ(testing::Refusal([&] { ExportCsv(reader, table); }), ErrorKind::kUnavailable);
}

double Wave(int i, int j, int k) { return std::floor(7.0 * i + 5.0 * j * j - 3.0 * i * k); }

// Written down once: recordings name volumes by it for ever.
TEST(VolumeHash, IsTheSameForEver) {
  const VolumeHash hash = HashVolume(*MakeVolume({9, 10, 17}, Wave));
  EXPECT_EQ(hash.high, 0x3fae844f1b39a37fu);
  EXPECT_EQ(hash.low, 0xeff147bcc4a7bc8au);
}

TEST(VolumeHash, DependsOnWhatIsFeltAlone) {
  const auto volume = MakeVolume({9, 10, 17}, Wave);
  const VolumeHash hash = HashVolume(*volume);
  EXPECT_EQ(HashVolume(*MakeVolume({9, 10, 17}, Wave, 99)), hash);  // another revision
  const auto one_voxel = [](int i, int j, int k) {
    return Wave(i, j, k) + (i == 8 && j == 9 && k == 16 ? 1e-3 : 0.0);
  };
  EXPECT_NE(HashVolume(*MakeVolume({9, 10, 17}, one_voxel)), hash);
  const auto scaled = [](int i, int j, int k) { return 2.0 * Wave(i, j, k); };
  EXPECT_NE(HashVolume(*MakeVolume({9, 10, 17}, scaled)), hash);
  // The same numbers in another shape.
  const auto in_row = [](int i, int j, int k) { return double{1.0} * ((i * 4 + j) * 4 + k); };
  const auto in_other_row = [](int i, int j, int k) { return double{1.0} * ((i * 2 + j) * 4 + k); };
  EXPECT_NE(HashVolume(*MakeVolume({2, 4, 4}, in_row)),
            HashVolume(*MakeVolume({4, 2, 4}, in_other_row)));
}

std::vector<DeviceState> PathOf(const std::string& bytes,
                                std::size_t longest = kLongestPathStates) {
  RecordingReader reader = testing::ReadBytes(bytes);
  return ReadStylusPath(reader, "test", longest);
}

std::vector<double> XOf(const std::vector<DeviceState>& path) {
  std::vector<double> x_mm;
  for (const DeviceState& state : path) x_mm.push_back(state.p_MHip_mm.x());
  return x_mm;
}

TEST(RecordedPath, GivesWhatTheStylusDid) {
  TickSample sample = Sample(7);
  sample.stylus_orientation = {0.5, -0.5, 0.5, 0.5};
  sample.buttons = 3;
  sample.docked = true;
  sample.calibrated = false;
  const std::vector<DeviceState> path = PathOf(Record({sample, Sample(8)}));
  ASSERT_EQ(path.size(), 2u);
  EXPECT_EQ(path[0].p_MHip_mm, Vec3(7, 2, 3));
  EXPECT_EQ(path[0].R_MS.w(), 0.5);
  EXPECT_EQ(path[0].R_MS.x(), -0.5);
  EXPECT_EQ(path[0].buttons, 3u);
  EXPECT_TRUE(path[0].docked);
  EXPECT_FALSE(path[0].calibrated);
  EXPECT_FALSE(path[1].docked);
}

TEST(RecordedPath, HoldsTheLastStateInGapsAndWhereTicksWereMissed) {
  const std::string bytes = Record([](RecordingWriter& writer) {
    testing::Append(writer, std::vector{Sample(5), Sample(6)});
    writer.SkipTo(9);
    testing::Append(writer, std::vector{Sample(9)});
  });
  EXPECT_EQ(XOf(PathOf(bytes)), (std::vector<double>{5, 6, 6, 6, 9}));
  EXPECT_EQ(XOf(PathOf(Record({Sample(5, 10), Sample(6, 10), Sample(7, 12), Sample(8, 12)}))),
            (std::vector<double>{5, 6, 6, 6, 7, 8}));
}

TEST(RecordedPath, SkipsRejectedPositions) {
  std::vector<TickSample> samples;
  for (std::uint64_t tick = 0; tick < 8; ++tick) samples.push_back(Sample(tick));
  samples[0].input_rejected = true;
  samples[1].hip_mm[2] = std::nan("");
  samples[4].input_rejected = true;
  samples[4].buttons = 1;
  samples[5].stylus_orientation = {0, 0, 0, 0};
  samples[6].stylus_orientation[1] = std::nan("");
  const std::vector<DeviceState> path = PathOf(Record(samples));
  EXPECT_EQ(XOf(path), (std::vector<double>{2, 3, 3, 3, 3, 7}));
  EXPECT_EQ(path[2].buttons, 0u);
  EXPECT_NO_THROW(ReplayDevice device(path));
}

TEST(RecordedPath, RefusesWhatIsCutOrHoldsNoPositionOrRunsBackwards) {
  TickSample rejected = Sample(1);
  rejected.input_rejected = true;
  const std::string whole = Record({Sample(1), Sample(2)});
  for (const std::string& bad :
       {Record([](RecordingWriter&) {}), Record({rejected}), Record({Sample(1)}, false),
        whole.substr(0, whole.size() - 1), Record({Sample(5, 9), Sample(6, 2)}),
        Record({Sample(5, 9), Sample(6, 8)})}) {
    EXPECT_EQ(Refusal([&] { PathOf(bad); }), ErrorKind::kInvalidArgument);
  }
}

TEST(RecordedPath, IsBoundedWhateverTheNumbers) {
  EXPECT_EQ(PathOf(Record({Sample(1), Sample(2), Sample(3)}), 3).size(), 3u);
  EXPECT_EQ(Refusal([] {
              PathOf(Record({Sample(1), Sample(2), Sample(3)}), 2);
            }),
            ErrorKind::kTooLarge);
  constexpr std::uint64_t kHuge = std::numeric_limits<std::uint64_t>::max() / 2;
  EXPECT_EQ(Refusal([&] { PathOf(Record({Sample(1), Sample(2, kHuge)})); }), ErrorKind::kTooLarge);
  const std::string gap = Record([](RecordingWriter& writer) {
    testing::Append(writer, std::vector{Sample(5)});
    writer.SkipTo(kHuge);
    testing::Append(writer, std::vector{Sample(kHuge)});
  });
  EXPECT_EQ(Refusal([&] { PathOf(gap); }), ErrorKind::kTooLarge);
}

TEST(RecordedPath, RefusesAnotherRate) {
  for (const double period_s : {0.001, 0.0005, 0.0, std::nan("")}) {
    const std::string bytes = Record([&](RecordingWriter& writer) {
      RecordedScene scene;
      scene.tick = 1;
      scene.tick_period_s = period_s;
      writer.Append(scene);
      testing::Append(writer, std::vector{Sample(1)});
    });
    EXPECT_EQ(Refusal([&] { PathOf(bytes); }).has_value(), period_s != 0.001) << period_s;
  }
}

TEST(RecordedPath, ReadsFiles) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "a.palpate";
  std::ofstream(file, std::ios::binary) << Record({Sample(1), Sample(2)});
  EXPECT_EQ(XOf(ReadStylusPath(file)), (std::vector<double>{1, 2}));
  EXPECT_EQ(Refusal([&] { ReadStylusPath(folder.path() / "none"); }), ErrorKind::kNotFound);
  EXPECT_EQ(Refusal([&] { ReadStylusPath(folder.path()); }), ErrorKind::kInvalidArgument);
  EXPECT_NE(testing::Complaint([&] { ReadStylusPath(file, 1); }).find(file.string()),
            std::string::npos);
}

TickSample Live(std::uint64_t tick, std::uint64_t missed = 0) {
  TickSample live;
  live.tick = tick;
  live.time_ns = static_cast<std::int64_t>(tick) * 7;
  live.missed_ticks = missed;
  live.scene_revision = 11;
  live.settings_revision = 12;
  live.volume_revision = 13;
  live.force_state = ForceState::kStopped;
  live.force_reason = ForceReason::kStopCall;
  live.force_limit_n = 2.5;
  return live;
}

void Fill(ShownSamples& shown, int count) {
  for (int n = 0; n < count; ++n) {
    TickSample sample = RandomSample(n);
    sample.settings_revision = 0;
    shown.Add(sample, n + 1.0);
  }
}

TEST(ShownSamples, WaitForTheirScene) {
  ShownSamples shown(1.0);
  for (std::uint64_t n = 1; n <= 4; ++n) {
    TickSample sample = RandomSample(static_cast<int>(n));
    sample.settings_revision = n < 3 ? 1 : 2;
    shown.Add(sample, static_cast<double>(n));
  }
  shown.SetScene(1, 100, 5);
  shown.Shown(Live(1));
  for (std::uint64_t n = 1; n < 5; ++n) EXPECT_EQ(shown.Shown(Live(1 + n)).settings_revision, 101u);
  EXPECT_EQ(shown.passed(), 2u);
  shown.SetScene(2, 100, 6);
  const TickSample sample = shown.Shown(Live(6));
  EXPECT_EQ(sample.settings_revision, 102u);
  EXPECT_EQ(sample.volume_revision, 6u);
  EXPECT_EQ(shown.passed(), 4u);
}

TEST(ShownSamples, AreLiveUntilTheFirstIsDue) {
  ShownSamples shown(1.0);
  EXPECT_EQ(shown.Shown(Live(5)).hip_mm, Live(5).hip_mm);
  EXPECT_FALSE(shown.Shown(Live(5)).replayed);
  shown.SetScene(7, 30, 21);
  Fill(shown, 3);
  for (std::uint64_t n = 0; n < 3; ++n) {
    const TickSample sample = shown.Shown(Live(6 + n));
    EXPECT_EQ(sample.tick, 6 + n);
    EXPECT_EQ(sample.time_ns, Live(6 + n).time_ns);
    EXPECT_EQ(sample.missed_ticks, 0u);
    EXPECT_EQ(sample.scene_revision, 11u);
    EXPECT_EQ(sample.settings_revision, 37u);
    EXPECT_EQ(sample.volume_revision, 21u);
    EXPECT_EQ(sample.buttons, RandomSample(n).buttons);
    EXPECT_EQ(sample.mode, RandomSample(n).mode);
    EXPECT_TRUE(sample.replayed);
    EXPECT_EQ(sample.force_state, ForceState::kStopped);
    EXPECT_EQ(sample.force_reason, ForceReason::kStopCall);
    EXPECT_EQ(sample.force_limit_n, 2.5);
  }
  // The last one stays, and nothing runs ahead meanwhile.
  EXPECT_EQ(shown.Shown(Live(100)).buttons, RandomSample(2).buttons);
  EXPECT_EQ(shown.position_ms(), 3.0);
  TickSample more = RandomSample(3);
  more.settings_revision = 7;
  shown.Add(more, 4.0);
  EXPECT_EQ(shown.Shown(Live(101)).buttons, RandomSample(3).buttons);
  EXPECT_EQ(shown.passed(), 4u);
  EXPECT_EQ(shown.waiting(), 0u);
}

TEST(ShownSamples, KeepTheirPace) {
  struct Case {
    double speed;
    std::uint64_t live, passed;
  };
  for (const Case& c :
       {Case{0.25, 400, 100}, Case{1.0, 400, 400}, Case{2.5, 400, 1000}, Case{100.0, 10, 1000}}) {
    ShownSamples shown(c.speed);
    Fill(shown, 2000);
    for (std::uint64_t n = 0; n <= c.live; ++n) shown.Shown(Live(n));
    EXPECT_EQ(shown.passed(), c.passed) << c.speed;
  }
  // Missed live ticks are time that has passed.
  ShownSamples shown(1.0);
  Fill(shown, 100);
  shown.Shown(Live(0));
  shown.Shown(Live(1, 49));
  EXPECT_EQ(shown.passed(), 50u);
}

}  // namespace
}  // namespace palpate
