#include "server/recording/recorded_path.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/device/replay_device.h"
#include "server/recording/recording_writer.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using testing::MemoryOutput;
using testing::Refusal;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// Of a stylus whose x is the number of the tick.
TickSample Sample(std::uint64_t tick, std::uint64_t missed = 0) {
  TickSample sample;
  sample.tick = tick;
  sample.missed_ticks = missed;
  sample.hip_mm = {static_cast<double>(tick), 2.0, 3.0};
  return sample;
}

std::string Record(const std::function<void(RecordingWriter&)>& write, bool end = true) {
  auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test");
  write(writer);
  if (end) writer.AppendEnd();
  return *bytes;
}

std::string Record(const std::vector<TickSample>& samples, bool end = true) {
  return Record([&](RecordingWriter& writer) { writer.AppendSamples(samples); }, end);
}

std::vector<DeviceState> PathOf(const std::string& bytes,
                                std::size_t longest = kLongestPathStates) {
  RecordingReader reader = testing::ReadBytes(bytes);
  return ReadStylusPath(reader, "test", longest);
}

std::vector<double> XOf(const std::vector<DeviceState>& path) {
  std::vector<double> x_mm;
  for (const DeviceState& state : path) x_mm.push_back(state.p_DHip_mm.x());
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
  EXPECT_EQ(path[0].p_DHip_mm, Vec3(7, 2, 3));
  EXPECT_EQ(path[0].R_DS.w(), 0.5);
  EXPECT_EQ(path[0].R_DS.x(), -0.5);
  EXPECT_EQ(path[0].buttons, 3u);
  EXPECT_TRUE(path[0].docked);
  EXPECT_FALSE(path[0].calibrated);
  EXPECT_FALSE(path[1].docked);
}

TEST(RecordedPath, HoldsTheLastStateInGapsAndWhereTicksWereMissed) {
  const std::string bytes = Record([](RecordingWriter& writer) {
    writer.AppendSamples(std::vector{Sample(5), Sample(6)});
    writer.SkipTo(9);
    writer.AppendSamples(std::vector{Sample(9)});
  });
  EXPECT_EQ(XOf(PathOf(bytes)), (std::vector<double>{5, 6, 6, 6, 9}));
  EXPECT_EQ(XOf(PathOf(Record({Sample(5, 10), Sample(6, 10), Sample(7, 12), Sample(8, 12)}))),
            (std::vector<double>{5, 6, 6, 6, 7, 8}));
}

TEST(RecordedPath, SkipsRejectedPositions) {
  std::vector<TickSample> samples;
  for (std::uint64_t tick = 0; tick < 8; ++tick) samples.push_back(Sample(tick));
  samples[0].input_rejected = true;
  samples[1].hip_mm[2] = kNan;
  samples[4].input_rejected = true;
  samples[4].buttons = 1;
  samples[5].stylus_orientation = {0, 0, 0, 0};
  samples[6].stylus_orientation[1] = kNan;
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
    writer.AppendSamples(std::vector{Sample(5)});
    writer.SkipTo(kHuge);
    writer.AppendSamples(std::vector{Sample(kHuge)});
  });
  EXPECT_EQ(Refusal([&] { PathOf(gap); }), ErrorKind::kTooLarge);
}

TEST(RecordedPath, RefusesAnotherRate) {
  for (const double period_s : {0.001, 0.0005, 0.0, kNan}) {
    const std::string bytes = Record([&](RecordingWriter& writer) {
      RecordedScene scene;
      scene.tick = 1;
      scene.tick_period_s = period_s;
      writer.Append(scene);
      writer.AppendSamples(std::vector{Sample(1)});
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
  try {
    ReadStylusPath(file, 1);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find(file.string()), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace palpate
