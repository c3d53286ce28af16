// Tables of recordings, and the names of volumes in them.
#include <gtest/gtest.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "server/recording/csv_export.h"
#include "server/recording/recording_writer.h"
#include "server/recording/volume_hash.h"
#include "tests/support/made_volume.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::MakeVolume;
using testing::MemoryOutput;
using testing::RandomSample;
using testing::ReadBytes;

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

std::string Table(const std::shared_ptr<std::string>& bytes) {
  RecordingReader reader = ReadBytes(*bytes);
  std::ostringstream table;
  ExportCsv(reader, table);
  EXPECT_TRUE(reader.complete());
  return table.str();
}

TEST(CsvExport, NumbersReadBackBitForBit) {
  const auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test");
  std::vector<TickSample> samples;
  for (std::uint64_t tick = 40; tick < 540; ++tick) samples.push_back(RandomSample(tick));
  writer.AppendSamples(samples);
  writer.AppendEnd();
  const std::vector<std::string> lines = Split(Table(bytes), '\n');
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
    EXPECT_EQ(fields[mode] == "ejecting", samples[n].mode == TickMode::kEjecting);
  }
}

TEST(CsvExport, MarkersStandOnTheirTick) {
  const auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test");
  writer.AppendSamples(std::vector<TickSample>(1));
  writer.Append(RecordedMarker{.tick = 1, .text = "trial \"7\""});
  writer.Append(RecordedMarker{.tick = 1, .text = "left"});
  for (std::uint64_t tick = 1; tick < 3; ++tick) {
    TickSample sample;
    sample.tick = tick;
    writer.AppendSamples(std::vector{sample});
  }
  writer.Append(RecordedMarker{.tick = 3, .text = "end, of it"});
  writer.AppendEnd();
  const std::vector<std::string> lines = Split(Table(bytes), '\n');
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_TRUE(lines[1].ends_with(",off,operator,none,0,ok,0,1,"));
  EXPECT_TRUE(lines[2].ends_with(",\"trial \"\"7\"\"; left\""));
  EXPECT_TRUE(lines[3].ends_with(",\"end, of it\""));
}

TEST(CsvExport, AFullStreamIsAnError) {
  const auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test");
  writer.AppendEnd();
  RecordingReader reader = ReadBytes(*bytes);
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

}  // namespace
}  // namespace palpate
