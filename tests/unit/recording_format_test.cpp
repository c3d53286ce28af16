// Recordings as bytes: all comes back bit for bit, and damage is seen.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "server/recording/bytes.h"
#include "server/recording/chunk_codec.h"
#include "server/recording/chunk_frame.h"
#include "server/recording/recording_reader.h"
#include "server/recording/recording_writer.h"
#include "server/recording/settings_text.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::FilledLeaf;
using testing::MemoryOutput;
using testing::RandomSample;
using testing::RandomSamples;
using testing::ReadAll;
using testing::ReadBytes;
using testing::Refusal;
using testing::SameSample;

HapticSettings RandomSettings(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 3.0);
  HapticSettings settings;
  for (const NumberSetting& number : kNumberSettings) settings.*number.member = uniform(random);
  for (const FlagSetting& flag : kFlagSettings) settings.*flag.member = random() % 2 == 1;
  settings.free_side = static_cast<FreeSide>(1 + random() % 2);
  settings.method = DecompositionMethod::kBcc;
  return settings;
}

RecordedScene SceneAt(std::uint64_t tick) {
  RecordedScene scene{.tick = tick,
                      .settings_revision = tick + 1,
                      .volume_revision = 3,
                      .loaded_revision = 2,
                      .geometry_revision = 4,
                      .isovalue = 1e-300,
                      .normalized_isovalue = 1.0 / 3.0,
                      .settings = RandomSettings(tick),
                      .volume_hash = {5, 6},
                      .volume_source = "head \xc3\xa4.nrrd",
                      .spacing_mm = Vec3(0.1, 2.0, 1e-3),
                      .voxels_missing = true,
                      .tick_period_s = 1e-3,
                      .safety = {.max_force_n = 3.2,
                                 .max_slew_n_per_s = 100.0,
                                 .ramp_in_s = 0.1,
                                 .continuous_force_n = 0.3,
                                 .thermal_time_s = 0.7,
                                 .max_speed_mm_per_s = 1e3,
                                 .max_missed_ticks = 7.0,
                                 .faults_stay = true,
                                 .starts_on = false,
                                 .stop_buttons = 5},
                      .device = {.resolution_mm = 0.07, .max_force_n = 8.0, .tick_s = 2e-3},
                      .reloadable = false,
                      .all_voxels_stored = true,
                      .size = Vec3i(4, 5, 6),
                      .value_min = -1e3,
                      .value_max = 0.1};
  scene.X_DI.linear << 1.0, 0.1, -2.0, 1e-9, 0.7, 3.0, 1.0 / 7.0, 0.0, 5.0;
  scene.X_DI.translation = Vec3(-0.0, 1e-320, 7.0);
  scene.X_WI.emplace().translation = Vec3(1.0, -2.5, 1.0 / 3.0);
  return scene;
}

// All bits, NaNs among them.
LeafPtr NoiseLeaf() {
  std::mt19937 random(1);
  Brick noise{};
  for (float& value : noise) value = std::bit_cast<float>(static_cast<std::uint32_t>(random()));
  return Leaf::Of(LeafType::kFloat, noise);
}

// A few ticks of everything: 7 to 10, a gap, 13 to 15.
std::string SmallRecording() {
  const auto bytes = std::make_shared<std::string>();
  RecordingWriter writer(std::make_unique<MemoryOutput>(bytes), "test 1.0");
  writer.Append(SceneAt(7));
  writer.Append(TimedMarker{.tick = 7, .time_ns = -5, .text = "trial \"1\", left"});
  writer.AppendSamples(RandomSamples(7, 4));
  writer.Append(RecordedEdit{.tick = 13,
                             .base_revision = 3,
                             .volume_revision = 4,
                             .bricks = {{2, FilledLeaf(-0.0f)}, {7, NoiseLeaf()}}});
  writer.Append(RecordedKeyframe{.tick = 13, .bytes = "state"});
  writer.AppendSamples(RandomSamples(13, 3));
  writer.AppendEnd();
  EXPECT_EQ(writer.counts().bytes, bytes->size());
  return *bytes;
}

// The samples among chunks are those recorded: RandomSample of their ticks.
std::uint64_t CountTrueSamples(const std::vector<RecordedChunk>& chunks) {
  const std::vector<TickSample> samples = testing::SamplesIn(chunks);
  for (const TickSample& sample : samples) {
    EXPECT_TRUE(SameSample(sample, RandomSample(sample.tick)));
  }
  return samples.size();
}

void ExpectSameScene(const RecordedScene& a, const RecordedScene& b) {
  EXPECT_EQ(EncodeChunk(a).bytes, EncodeChunk(b).bytes);
  EXPECT_EQ(SettingsText(a.settings), SettingsText(b.settings));
  EXPECT_TRUE(std::signbit(b.X_DI.translation.x()));
  const auto members = [](const RecordedScene& s) {
    return std::tie(s.X_DI.linear, s.X_DI.translation, s.volume_hash, s.volume_source,
                    s.loaded_revision, s.spacing_mm, s.voxels_missing, s.settings.method,
                    s.tick_period_s, s.safety, s.device, s.reloadable, s.all_voxels_stored, s.size,
                    s.value_min, s.value_max, s.isovalue, s.normalized_isovalue);
  };
  EXPECT_TRUE(members(a) == members(b));
  ASSERT_TRUE(a.X_WI && b.X_WI);
  EXPECT_EQ(*a.X_WI, *b.X_WI);
  EXPECT_TRUE(b.unknown_settings.empty());
}

TEST(RecordingFormat, EverythingComesBack) {
  RecordingReader reader = ReadBytes(SmallRecording());
  EXPECT_EQ(reader.header().program, "test 1.0");
  ASSERT_TRUE(reader.header().created_monotonic_ns);
  EXPECT_GT(*reader.header().created_monotonic_ns, 0);
  EXPECT_GT(reader.header().created_unix_ns, 1'600'000'000'000'000'000);
  const std::vector<RecordedChunk> chunks = ReadAll(reader);
  ASSERT_EQ(chunks.size(), 8u);
  ExpectSameScene(SceneAt(7), std::get<RecordedScene>(chunks[0]));
  const auto& marker = std::get<TimedMarker>(chunks[1]);
  EXPECT_EQ(marker.tick, 7u);
  EXPECT_EQ(marker.time_ns, -5);
  EXPECT_EQ(marker.text, "trial \"1\", left");
  const auto& gap = std::get<RecordedGap>(chunks[3]);
  EXPECT_EQ(gap.first_tick, 11u);
  EXPECT_EQ(gap.last_tick, 12u);
  const auto& edit = std::get<RecordedEdit>(chunks[4]);
  EXPECT_EQ(edit.tick, 13u);
  EXPECT_EQ(edit.base_revision, 3u);
  EXPECT_EQ(edit.volume_revision, 4u);
  ASSERT_EQ(edit.bricks.size(), 2u);
  EXPECT_EQ(edit.bricks[0].number, 2u);
  EXPECT_TRUE(HaveSameBits(*edit.bricks[0].values, *FilledLeaf(-0.0f)));
  EXPECT_EQ(edit.bricks[1].number, 7u);
  EXPECT_TRUE(HaveSameBits(*edit.bricks[1].values, *NoiseLeaf()));
  EXPECT_EQ(std::get<RecordedKeyframe>(chunks[5]).bytes, "state");
  EXPECT_EQ(CountTrueSamples(chunks), 7u);
  EXPECT_EQ(reader.ticks(), 7u);
  EXPECT_EQ(reader.lost_ticks(), 2u);
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(reader.stopped_because(), "");
}

TEST(RecordingFormat, ASceneOfVersion4HasNoPlaceInTheWorld) {
  RecordedScene old = SceneAt(7);
  old.X_WI.reset();
  RecordingReader reader =
      ReadBytes(FrameHeader({.program = "test"}) + FrameChunk(EncodeChunk(old), 0));
  const std::vector<RecordedChunk> chunks = ReadAll(reader);
  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_FALSE(std::get<RecordedScene>(chunks[0]).X_WI);
  EXPECT_FALSE(reader.header().created_monotonic_ns);
  EXPECT_EQ(std::get<RecordedScene>(chunks[0]).value_max, old.value_max);
}

TEST(RecordingFormat, ACutRecordingReadsUpToTheLastWholeChunk) {
  const std::string whole = SmallRecording();
  std::uint64_t refused = 0, last = 0;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string cut = whole.substr(0, size);
    try {
      RecordingReader reader = ReadBytes(cut);
      const std::uint64_t count = CountTrueSamples(ReadAll(reader));
      EXPECT_EQ(count, reader.ticks());
      EXPECT_FALSE(reader.complete());
      EXPECT_NE(reader.stopped_because(), "");
      EXPECT_GE(reader.ticks(), last);
      last = reader.ticks();
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument);
      ++refused;
    }
  }
  EXPECT_EQ(refused, FrameHeader({.created_monotonic_ns = 1, .program = "test 1.0"}).size());
  EXPECT_EQ(last, 7u);
}

TEST(RecordingFormat, EveryChangedByteIsSeen) {
  const std::string whole = SmallRecording();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const int change : {0x01, 0x80, 0xff}) {
      std::string damaged = whole;
      damaged[at] = static_cast<char>(damaged[at] ^ change);
      try {
        RecordingReader reader = ReadBytes(damaged);
        const std::uint64_t count = CountTrueSamples(ReadAll(reader));
        EXPECT_EQ(count, reader.ticks());
        EXPECT_FALSE(reader.complete()) << "byte " << at;
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument);
      }
    }
  }
}

TEST(RecordingFormat, ChunksThatAreMissingOrTwiceAreSeen) {
  const std::string header = FrameHeader({.program = "test"});
  const Payload marker = EncodeChunk(TimedMarker{.text = "m"});
  const Payload end = EncodeChunk(RecordedEnd{});
  const auto is_complete = [&](std::uint64_t second, std::uint64_t last) {
    RecordingReader reader = ReadBytes(header + FrameChunk(marker, 0) + FrameChunk(marker, second) +
                                       FrameChunk(end, last));
    ReadAll(reader);
    return reader.complete();
  };
  EXPECT_TRUE(is_complete(1, 2));
  EXPECT_FALSE(is_complete(0, 1));
  EXPECT_FALSE(is_complete(2, 3));
  EXPECT_FALSE(is_complete(1, 3));
}

TEST(RecordingFormat, BytesAfterTheEndAreSeen) {
  RecordingReader reader = ReadBytes(SmallRecording() + "x");
  ReadAll(reader);
  EXPECT_FALSE(reader.complete());
  EXPECT_NE(reader.stopped_because(), "");
}

TEST(RecordingFormat, LengthsAreLimitedBeforeMemoryIsTaken) {
  const std::string header = FrameHeader({.program = "test"});
  const std::string chunk = FrameChunk(EncodeChunk(RecordedGap{1, 2}), 0);
  for (const std::size_t at : {20u, 24u}) {  // raw_bytes, stored_bytes
    std::string damaged = chunk;
    damaged.replace(at, 4, "\xff\xff\xff\xff");
    RecordingReader reader = ReadBytes(header + damaged);
    EXPECT_FALSE(reader.Next());
    EXPECT_NE(reader.stopped_because(), "");
  }
  EXPECT_EQ(Refusal([] {
              FrameChunk({ChunkType::kEdit, std::string(kMaxPayloadBytes + 1, 'x')}, 0);
            }),
            ErrorKind::kTooLarge);
}

// 16 MiB of one letter pack into a few bytes.
TEST(RecordingFormat, TextsThatNobodyWritesAreDamaged) {
  RecordedScene scene = SceneAt(1);
  scene.volume_source = std::string(20'000, 'x');
  for (const RecordedChunk& chunk :
       {RecordedChunk(TimedMarker{.text = std::string(4097, 'x')}), RecordedChunk(scene)}) {
    const Payload payload = EncodeChunk(chunk);
    EXPECT_THROW(DecodeChunk(payload), DamagedBytes);
  }
  EXPECT_NO_THROW(DecodeChunk(EncodeChunk(TimedMarker{.text = std::string(4096, 'x')})));
}

TEST(RecordingFormat, AChunkOfNoKindIsDamaged) {
  EXPECT_THROW(DecodeChunk({static_cast<ChunkType>(99), ""}), DamagedBytes);
}

TEST(RecordingFormat, OtherFilesAreRefusedInOneLine) {
  for (const std::string& bytes : {std::string(), std::string("NRRD0005\n"),
                                   std::string(1000, '\0'), std::string("\x89PLPREC\n")}) {
    EXPECT_EQ(Refusal([&] { ReadBytes(bytes); }), ErrorKind::kInvalidArgument);
  }
  std::string newer = FrameHeader({.created_monotonic_ns = 1, .program = "test"});
  newer[8] = 7;
  EXPECT_NE(testing::Complaint([&] { ReadBytes(newer); }).find('7'), std::string::npos);
  EXPECT_EQ(Refusal([] { RecordingReader("/nowhere/recording"); }), ErrorKind::kNotFound);
}

TEST(RecordingFormat, DevicesThatCannotBeAreRefused) {
  RecordedScene scene = SceneAt(7);
  for (const double number : {0.0, -0.055, std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::infinity()}) {
    scene.device = {.resolution_mm = number};
    EXPECT_THROW(DecodeChunk(EncodeChunk(scene)), DamagedBytes);
    scene.device = {.max_force_n = number};
    EXPECT_THROW(DecodeChunk(EncodeChunk(scene)), DamagedBytes);
    scene.device = {.tick_s = number};
    EXPECT_THROW(DecodeChunk(EncodeChunk(scene)), DamagedBytes);
  }
}

TEST(RecordingFormat, TicksDoNotGoBack) {
  RecordingWriter writer(std::make_unique<MemoryOutput>(std::make_shared<std::string>()), "test");
  writer.AppendSamples(RandomSamples(10, 2));
  EXPECT_EQ(Refusal([&] { writer.AppendSamples(RandomSamples(11, 1)); }),
            ErrorKind::kInvalidArgument);
}

TEST(SettingsText, ComesBackBitForBit) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const HapticSettings settings = RandomSettings(seed);
    std::vector<std::string> unknown;
    const HapticSettings read = SettingsFromText(SettingsText(settings), unknown);
    for (const NumberSetting& number : kNumberSettings) {
      ASSERT_EQ(read.*number.member, settings.*number.member);
    }
    for (const FlagSetting& flag : kFlagSettings) {
      ASSERT_EQ(read.*flag.member, settings.*flag.member);
    }
    ASSERT_EQ(read.free_side, settings.free_side);
    EXPECT_TRUE(unknown.empty());
  }
}

TEST(SettingsText, OfOtherVersionsIsRead) {
  std::vector<std::string> unknown;
  const HapticSettings read =
      SettingsFromText("stiffness_n_per_mm=1.25\ntexture_mm=0.1\nforce_shading=on\n", unknown);
  EXPECT_EQ(read.stiffness_n_per_mm, 1.25);
  EXPECT_TRUE(read.force_shading);
  EXPECT_EQ(read.magnet_range_mm, HapticSettings{}.magnet_range_mm);
  EXPECT_EQ(unknown, std::vector<std::string>{"texture_mm"});
  for (const char* bad :
       {"stiffness_n_per_mm=1.25", "stiffness_n_per_mm\n", "stiffness_n_per_mm=1x\n",
        "stiffness_n_per_mm=\n", "force_shading=1\n", "free_side=left\n", "\n"}) {
    EXPECT_THROW(SettingsFromText(bad, unknown), DamagedBytes) << bad;
  }
}

}  // namespace
}  // namespace palpate
