// Recordings as files: all comes back bit for bit, damage is seen, and hostile files cost little.
#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/dynamic_message.h>
#include <gtest/gtest.h>
#include <zstd.h>

#include <bit>
#include <cctype>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/wire/values.h"
#include "server/recording/bytes.h"
#include "server/recording/mcap.h"
#include "server/recording/recorded_messages.h"
#include "server/recording/tick_layout.h"
#include "server/recording/voxel_log.h"
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
  settings.refinement = static_cast<double>(1 + random() % 4);
  for (const FlagSetting& flag : kFlagSettings) settings.*flag.member = random() % 2 == 1;
  settings.free_side = static_cast<FreeSide>(1 + random() % 2);
  settings.method = DecompositionMethod::kBcc;
  for (std::uint32_t n = 0; n < seed % 4; ++n) {
    SurfaceLayer layer{.id = 8 - n, .name = std::to_string(n), .isovalue = n + uniform(random) / 4};
    layer.stiffness_n_per_mm = uniform(random);
    if (n == 1) layer.pop_out_force_n = uniform(random);
    settings.layers.layer.push_back(layer);
  }
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
  writer.Append(RecordedEvent{.tick = 7, .time_ns = -5, .marker = "trial \"1\", left"});
  testing::Append(writer, RandomSamples(7, 4));
  writer.Append(RecordedEdit{.tick = 13,
                             .base_revision = 3,
                             .volume_revision = 4,
                             .bricks = {{2, FilledLeaf(-0.0f)}, {7, NoiseLeaf()}},
                             .known = {}});
  writer.Append(RecordedKeyframe{.tick = 13, .state = "state"});
  testing::Append(writer, RandomSamples(13, 3));
  writer.AppendEnd();
  EXPECT_EQ(writer.counts().bytes, bytes->size());
  return *bytes;
}

// The samples among the items are those recorded: RandomSample of their ticks.
std::uint64_t CountTrueSamples(const std::vector<RecordedItem>& items) {
  const std::vector<TickSample> samples = testing::SamplesIn(items);
  for (const TickSample& sample : samples) {
    EXPECT_TRUE(SameSample(sample, RandomSample(sample.tick)));
  }
  return samples.size();
}

TEST(RecordingFormat, EverythingComesBack) {
  RecordingReader reader = ReadBytes(SmallRecording());
  EXPECT_EQ(reader.header().program, "test 1.0");
  ASSERT_TRUE(reader.header().created_monotonic_ns);
  EXPECT_GT(*reader.header().created_monotonic_ns, 0);
  EXPECT_GT(reader.header().created_unix_ns, 1'600'000'000'000'000'000);
  const std::vector<RecordedItem> items = ReadAll(reader);
  ASSERT_EQ(items.size(), 7u);
  const auto& scene = std::get<RecordedScene>(items[0]);
  EXPECT_EQ(ToProto(scene).SerializeAsString(), ToProto(SceneAt(7)).SerializeAsString());
  EXPECT_TRUE(std::signbit(scene.X_DI.translation.x()));
  EXPECT_TRUE(scene.unknown_settings.empty());
  const auto& marker = std::get<RecordedEvent>(items[1]);
  EXPECT_EQ(marker, (RecordedEvent{7, -5, "trial \"1\", left"}));
  const auto& gap = std::get<RecordedGap>(items[3]);
  EXPECT_EQ(gap.first_tick, 11u);
  EXPECT_EQ(gap.last_tick, 12u);
  const auto& edit = std::get<RecordedEdit>(items[4]);
  EXPECT_EQ(edit.tick, 13u);
  EXPECT_EQ(edit.base_revision, 3u);
  EXPECT_EQ(edit.volume_revision, 4u);
  ASSERT_EQ(edit.bricks.size(), 2u);
  for (const RecordedBrick& brick : edit.bricks) {
    const LeafPtr expected = brick.number == 2 ? FilledLeaf(-0.0f) : NoiseLeaf();
    EXPECT_TRUE(HaveSameBits(*brick.values, *expected)) << brick.number;
  }
  EXPECT_EQ(std::get<RecordedKeyframe>(items[5]), (RecordedKeyframe{13, "state"}));
  EXPECT_EQ(CountTrueSamples(items), 7u);
  EXPECT_EQ(reader.ticks(), 7u);
  EXPECT_EQ(reader.lost_ticks(), 2u);
  EXPECT_TRUE(reader.complete());
  EXPECT_EQ(reader.stopped_because(), "");
}

// Every member of a scene: by its message, which has nothing else.
TEST(RecordingFormat, ScenesComeBackBitForBit) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    RecordedScene scene = SceneAt(seed);
    if (seed % 2 == 1) scene.X_WI.reset();
    if (seed % 3 == 1) scene.series_position_frames = 0.1 * static_cast<double>(seed);
    if (seed % 5 == 1) {
      scene.fields = {Ball{1.0 / 3.0, Mat3(Vec3(0.3, -0.7, 0.2).asDiagonal()), true}};
    }
    if (seed % 10 == 1) {
      scene.tool = {.name = "drill",
                    .ball = {{Vec3(0.1, -0.2, 1.0 / 7.0), 1.0 / 3.0, true}, {Vec3::Zero(), 0.0}},
                    .rotation_length_mm = 100.0 / 3.0};
      scene.settings.tool = scene.tool;
    }
    const v1::RecordedScene message = ToProto(scene);
    const RecordedScene read = FromProto(message);
    EXPECT_EQ(ToProto(read).SerializeAsString(), message.SerializeAsString());
    for (const NumberSetting& number : kNumberSettings) {
      ASSERT_EQ(read.settings.*number.member, scene.settings.*number.member);
    }
    EXPECT_EQ(read.settings.method, scene.settings.method);
    EXPECT_EQ(read.settings.layers, scene.settings.layers);
    EXPECT_EQ(read.settings.free_side, scene.settings.free_side);
    EXPECT_EQ(read.X_DI, scene.X_DI);
    EXPECT_EQ(read.X_WI, scene.X_WI);
    EXPECT_EQ(read.safety, scene.safety);
    EXPECT_EQ(read.device, scene.device);
    EXPECT_EQ(read.volume_hash, scene.volume_hash);
    EXPECT_EQ(read.size, scene.size);
    EXPECT_EQ(read.series_position_frames, scene.series_position_frames);
    EXPECT_EQ(read.fields, scene.fields);
    EXPECT_EQ(read.tool, scene.tool);
    EXPECT_EQ(read.settings.tool, scene.settings.tool);
  }
}

// A later program adds settings, and an earlier one lacks some.
TEST(RecordingFormat, ScenesOfOtherVersionsAreRead) {
  v1::RecordedScene message = ToProto(SceneAt(1));
  message.mutable_settings()->clear_stiffness_n_per_mm();
  message.mutable_settings()->clear_refinement();
  message.clear_safety();
  message.clear_device();
  RecordedScene read = FromProto(message);
  EXPECT_EQ(read.settings.stiffness_n_per_mm, 0.5);  // whatever the default is now
  EXPECT_EQ(read.settings.refinement, 1);
  EXPECT_EQ(read.safety, SafetyLimits{});
  EXPECT_EQ(read.device, PassivityDevice{});
  auto& settings = *message.mutable_settings();
  settings.GetReflection()->MutableUnknownFields(&settings)->AddVarint(1000, 7);
  read = FromProto(message);
  ASSERT_EQ(read.unknown_settings.size(), 1u);
  EXPECT_NE(read.unknown_settings[0].find("1000"), std::string::npos);
  settings.set_free_side(static_cast<v1::FreeSide>(9));
  EXPECT_THROW(FromProto(message), DamagedBytes);
  for (const double refinement : {0.0, 2.5, 5.0, std::numeric_limits<double>::quiet_NaN()}) {
    message = ToProto(SceneAt(1));
    message.mutable_settings()->set_refinement(refinement);
    EXPECT_THROW(FromProto(message), DamagedBytes) << refinement;
  }
}

TEST(RecordingFormat, LayersThatCannotBeAreRefused) {
  for (const std::uint32_t id : {7u, 9u}) {
    v1::RecordedScene message = ToProto(SceneAt(2));
    message.mutable_settings()->mutable_layers()->mutable_layer(0)->set_id(id);
    EXPECT_THROW(FromProto(message), DamagedBytes) << id;
  }
}

// A field of theirs would take forever, or does not exist.
TEST(RecordingFormat, BallsThatCannotBeAreRefused) {
  RecordedScene scene = SceneAt(7);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Mat3 flat = Mat3::Identity();
  flat.col(2) = flat.col(1) + 1e-6 * Vec3::UnitZ();
  for (const Ball& ball : {Ball{0.29}, Ball{8.1}, Ball{nan}, Ball{-1.0}, Ball{1.0, Mat3::Zero()},
                           Ball{1.0, Mat3::Constant(nan)}, Ball{1.0, flat}}) {
    scene.fields = {ball};
    EXPECT_THROW(FromProto(ToProto(scene)), DamagedBytes);
  }
}

TEST(RecordingFormat, DevicesThatCannotBeAreRefused) {
  RecordedScene scene = SceneAt(7);
  for (const double number : {0.0, -0.055, std::numeric_limits<double>::quiet_NaN(),
                              std::numeric_limits<double>::infinity()}) {
    for (double PassivityDevice::*member :
         {&PassivityDevice::resolution_mm, &PassivityDevice::max_force_n,
          &PassivityDevice::tick_s}) {
      scene.device = {};
      scene.device.*member = number;
      EXPECT_THROW(FromProto(ToProto(scene)), DamagedBytes);
    }
  }
}

// What is written by hand for speed is what protobuf reads, and numbers stay in their places.
TEST(ConstantLayout, IsTheMessageInOneLengthForEachShape) {
  std::set<std::size_t> lengths;
  for (std::uint64_t tick = 0; tick < 2000; ++tick) {
    TickSample sample = RandomSample(tick);
    if (tick % 2 == 0) {  // numbers as they are
      for (std::uint64_t* number :
           {&sample.scene_revision, &sample.settings_revision, &sample.volume_revision,
            &sample.missed_ticks, &sample.capped_ticks, &sample.faulty_ticks,
            &sample.touching_balls}) {
        *number %= std::uint64_t{1} << 40;
      }
      sample.time_ns = sample.time_ns & (std::numeric_limits<std::int64_t>::max() >> 1);
      sample.update_ns = sample.update_ns & 0xffffff;
    }
    const RecordedTick value = RecordedTickOf(sample);
    ConstantLayout layout;
    Put(value, layout);
    v1::RecordedTick message;
    ASSERT_TRUE(
        message.ParseFromArray(layout.bytes().data(), static_cast<int>(layout.bytes().size())));
    ASSERT_EQ(message.SerializeAsString(), ToProto(value).SerializeAsString());
    if (tick % 2 == 0) lengths.insert(layout.bytes().size());
  }
  // Normal of H, SCP_V, led target, series, tool: there or not.
  EXPECT_LE(lengths.size(), 32u);
}

TEST(RecordedSchema, SaysWhatAMessageIsAndNoMore) {
  google::protobuf::FileDescriptorSet set;
  const std::string schema = SchemaOf(*v1::RecordedTick::descriptor());
  EXPECT_LT(schema.size(), 4096u);
  ASSERT_TRUE(set.ParseFromString(schema));
  google::protobuf::DescriptorPool pool;
  for (const auto& file : set.file()) {
    ASSERT_NE(pool.BuildFile(file), nullptr) << file.name();
    EXPECT_EQ(file.service_size(), 0);
  }
  google::protobuf::DynamicMessageFactory factory(&pool);
  const auto* type = pool.FindMessageTypeByName("palpate.v1.RecordedTick");
  ASSERT_NE(type, nullptr);
  const std::unique_ptr<google::protobuf::Message> message(factory.GetPrototype(type)->New());
  const v1::RecordedTick tick = ToProto(RecordedTickOf(RandomSample(5)));
  ASSERT_TRUE(message->ParseFromString(tick.SerializeAsString()));
  EXPECT_EQ(message->SerializeAsString(), tick.SerializeAsString());
  EXPECT_TRUE(message->GetReflection()->GetUnknownFields(*message).empty());
  for (const google::protobuf::Descriptor* other :
       {v1::RecordedScene::descriptor(), v1::RecordedVoxels::descriptor()}) {
    google::protobuf::DescriptorPool whole;
    ASSERT_TRUE(set.ParseFromString(SchemaOf(*other)));
    for (const auto& file : set.file()) EXPECT_NE(whole.BuildFile(file), nullptr) << file.name();
  }
}

// Where each chunk of a file ends.
std::vector<std::size_t> ChunkEnds(const std::string& file) {
  std::vector<std::size_t> ends;
  for (std::size_t at = mcap::kMagic.size(); at + mcap::kRecordHeadBytes <= file.size();) {
    std::uint64_t bytes = 0;
    std::memcpy(&bytes, &file[at + 1], sizeof bytes);
    const bool is_chunk = file[at] == static_cast<char>(mcap::Opcode::kChunk);
    at += mcap::kRecordHeadBytes + bytes;
    if (is_chunk) ends.push_back(at);
  }
  return ends;
}

TEST(RecordingFormat, ACutRecordingReadsUpToTheLastWholeChunk) {
  const std::string whole = SmallRecording();
  const std::vector<std::size_t> ends = ChunkEnds(whole);
  ASSERT_EQ(ends.size(), 2u);
  std::size_t refused = 0;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string cut = whole.substr(0, size);
    try {
      RecordingReader reader = ReadBytes(cut);
      const std::uint64_t count = CountTrueSamples(ReadAll(reader));
      EXPECT_EQ(count, size >= ends[1] ? 7u : size >= ends[0] ? 4u : 0u) << size;
      EXPECT_EQ(count, reader.ticks());
      EXPECT_FALSE(reader.complete());
      EXPECT_NE(reader.stopped_because(), "");
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument);
      refused = size;
    }
  }
  EXPECT_LT(refused, ends[0]);
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

TEST(RecordingFormat, BytesAfterTheEndAreSeen) {
  RecordingReader reader = ReadBytes(SmallRecording() + "x");
  ReadAll(reader);
  EXPECT_FALSE(reader.complete());
  EXPECT_NE(reader.stopped_because(), "");
}

TEST(RecordingFormat, OtherFilesAreRefusedInOneLine) {
  for (const std::string& bytes : {std::string(), std::string("NRRD0005\n"),
                                   std::string(1000, '\0'), std::string(mcap::kMagic)}) {
    EXPECT_EQ(Refusal([&] { ReadBytes(bytes); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([] { RecordingReader("/nowhere/recording"); }), ErrorKind::kNotFound);
}

TEST(RecordingFormat, TicksDoNotGoBack) {
  RecordingWriter writer(std::make_unique<MemoryOutput>(std::make_shared<std::string>()), "test");
  testing::Append(writer, RandomSamples(10, 2));
  EXPECT_EQ(Refusal([&] { writer.Append(RandomSample(11)); }), ErrorKind::kInvalidArgument);
}

// A file that somebody else made with an MCAP writer.
class Foreign {
 public:
  Foreign() : writer_([this](std::string_view bytes) { bytes_ += bytes; }, "another program") {
    writer_.AddMetadata({kHeaderMetadata, {{"created_unix_ns", "5"}}});
  }
  void Add(const std::string& topic, const std::string& message) {
    std::string schema = "palpate.v1.Recorded" + topic.substr(1);
    schema[19] = static_cast<char>(std::toupper(schema[19]));
    writer_.AddMessage(writer_.AddChannel(topic, schema, ""), 1, message);
  }
  void Add(const TickSample& sample) {
    Add(kTickTopic, ToProto(RecordedTickOf(sample)).SerializeAsString());
  }
  std::string End(std::uint64_t ticks, std::uint64_t lost_ticks = 0) {
    writer_.EndChunk();
    writer_.AddMetadata(
        {kEndMetadata,
         {{"ticks", std::to_string(ticks)}, {"lost_ticks", std::to_string(lost_ticks)}}});
    writer_.End();
    return bytes_;
  }
  mcap::Writer& writer() { return writer_; }
  std::string& bytes() { return bytes_; }

 private:
  std::string bytes_;
  mcap::Writer writer_;
};

// Ticks as protobuf writes them, among topics of others.
TEST(ForeignRecording, IsReadWhereItIsOne) {
  Foreign file;
  file.Add("/tf", "whatever");
  for (const TickSample& sample : RandomSamples(3, 5)) file.Add(sample);
  file.Add("/camera", std::string(1000, 'x'));
  for (const TickSample& sample : RandomSamples(10, 2)) file.Add(sample);
  RecordingReader reader = ReadBytes(file.End(7, 5));  // 8, 9; and three at the end
  EXPECT_EQ(CountTrueSamples(ReadAll(reader)), 7u);
  EXPECT_TRUE(reader.complete()) << reader.stopped_because();
  EXPECT_EQ(reader.lost_ticks(), 5u);
  EXPECT_FALSE(reader.header().created_monotonic_ns);
}

TEST(ForeignRecording, ThatMakesNoSenseEndsWhereItDoesNot) {
  const std::string tick = ToProto(RecordedTickOf(RandomSample(9))).SerializeAsString();
  const std::function<void(Foreign&)> attacks[] = {
      [&](Foreign& file) { file.Add(kTickTopic, tick.substr(0, 50)); },
      [&](Foreign& file) { file.Add(kTickTopic, ""); },   // of no known words
      [&](Foreign& file) { file.Add(RandomSample(3)); },  // goes back
      [&](Foreign& file) { file.Add(kSceneTopic, "\xff\xff"); },
      [&](Foreign& file) { file.Add(kSceneTopic, ""); },  // without a place
      [&](Foreign& file) { file.Add(kVoxelsTopic, "\x22\x03\x0a\x01\x05"); },
      [&](Foreign& file) {
        file.Add(kEventTopic,
                 ToProto(RecordedEvent{9, 1, std::string(4097, 'x')}).SerializeAsString());
      },
      [&](Foreign& file) { file.writer().AddMessage(60'000, 1, tick); },
      [&](Foreign& file) {  // bricks without end that no scene needs
        v1::RecordedVoxels voxels;
        v1::VolumeTile& tile = *voxels.mutable_bricks()->add_tiles();
        tile.set_bricks(VoxelLog::kMaxBricksPerScene);
        voxels.mutable_bricks()->set_voxel_type(v1::VOXEL_TYPE_FLOAT32);
        for (int n = 0; n < 2; ++n) file.Add(kVoxelsTopic, voxels.SerializeAsString());
      },
  };
  for (const auto& attack : attacks) {
    Foreign file;
    file.Add(RandomSample(4));
    file.writer().EndChunk();
    attack(file);
    RecordingReader reader = ReadBytes(file.End(1));
    EXPECT_EQ(CountTrueSamples(ReadAll(reader)), 1u);
    EXPECT_FALSE(reader.complete()) << &attack - attacks;
    EXPECT_NE(reader.stopped_because(), "");
  }
  for (const auto& [ticks, lost] : {std::pair(2u, 0u), std::pair(0u, 0u)}) {
    Foreign file;
    file.Add(RandomSample(4));
    RecordingReader reader = ReadBytes(file.End(ticks, lost));
    ReadAll(reader);
    EXPECT_FALSE(reader.complete());
  }
}

TEST(ForeignRecording, NothingComesAfterTheGreatestTick) {
  constexpr auto kMost = std::numeric_limits<std::uint64_t>::max();
  Foreign file;
  for (const std::uint64_t tick : {kMost - 2, kMost - 1, kMost, std::uint64_t{0}}) {
    file.Add(RandomSample(tick));
  }
  RecordingReader reader = ReadBytes(file.End(4));
  EXPECT_EQ(CountTrueSamples(ReadAll(reader)), 2u);
  EXPECT_FALSE(reader.complete());
}

std::string ChunkRecord(std::uint64_t unpacked_bytes, std::uint32_t crc, const std::string& packing,
                        const std::string& packed) {
  ByteWriter content;
  content.Put(std::uint64_t{1});
  content.Put(std::uint64_t{1});
  content.Put(unpacked_bytes);
  content.Put(crc);
  content.PutText(packing);
  content.Put(static_cast<std::uint64_t>(packed.size()));
  content.PutBytes(packed);
  return mcap::Frame(mcap::Opcode::kChunk, content.bytes());
}

TEST(ForeignRecording, ThatIsHostileCostsLittle) {
  Foreign good;
  good.Add(RandomSample(4));
  good.writer().EndChunk();
  std::string bomb(ZSTD_compressBound(mcap::kMostChunkBytes + 1), '\0');
  const std::string zeros(mcap::kMostChunkBytes + 1, '\0');
  bomb.resize(ZSTD_compress(bomb.data(), bomb.size(), zeros.data(), zeros.size(), 1));
  std::string record(mcap::kRecordHeadBytes, '\x05');
  const std::string tail[] = {
      record,                                      // as long as 2^58
      record.replace(1, 8, 8, '\xff'),             // 2^64 - 1
      ChunkRecord(100, 0, "zstd", bomb),           // has more than it says
      ChunkRecord(zeros.size(), 0, "zstd", bomb),  // too large
      ChunkRecord(5, 1, "", "abcde"),              // another checksum
      ChunkRecord(5, 0, "", "abc"),
      ChunkRecord(5, 0, "lz4", "abc"),
      ChunkRecord(5, 0, "zstd", "abc"),
      ChunkRecord(9, 0, "", std::string("\x06") + std::string(8, '\0')),  // a chunk within a chunk
      ChunkRecord(9, 0, "", std::string("\x05") + std::string(8, '\x7f')),
  };
  for (const std::string& bytes : tail) {
    RecordingReader reader = ReadBytes(good.bytes() + bytes);
    EXPECT_EQ(CountTrueSamples(ReadAll(reader)), 1u);
    EXPECT_EQ(reader.stopped_because().find("was not closed"), std::string::npos)
        << &bytes - tail << reader.stopped_because();
  }
  Foreign many;
  many.Add(RandomSample(4));
  many.writer().EndChunk();
  for (int n = 0; n < 40'000; ++n)
    many.writer().AddChannel("/" + std::to_string(n), "palpate.v1.X", "");
  RecordingReader reader = ReadBytes(many.End(1));
  ReadAll(reader);
  EXPECT_FALSE(reader.complete());
}

}  // namespace
}  // namespace palpate
