// The hand-over between importer and daemon: what is written comes back, and an importer that lies
// is refused before anything is done with what it says.
#include "server/volume/load/handover.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include "common/error/error.h"
#include "tests/support/refusal.h"
#include "tests/support/written_handover.h"

namespace palpate {
namespace {

using testing::Refusal;
using testing::WriteHandover;

constexpr int kX = 20, kY = 11, kZ = 9;

float ValueAt(int i, int j, int k) { return static_cast<float>((3 * i + 5 * j + 7 * k) % 101); }

VolumeMetadata HeadMetadata() {
  VolumeMetadata metadata;
  metadata.size = {kX, kY, kZ};
  metadata.spacing_mm = {0.5, 0.75, 1.25};
  metadata.origin_W_mm = {-10.0, 20.0, 30.5};
  metadata.direction << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  metadata.value_min = 0.0;
  metadata.value_max = 100.0;
  metadata.frames = 20;
  metadata.unit = "HU";
  metadata.window_level = 700.0;
  metadata.window_width = 2600.0;
  metadata.patient_axes = "LPS";
  metadata.original_type = "int16";
  metadata.source = "head scan.nrrd";
  return metadata;
}

std::vector<float> Voxels() {
  std::vector<float> voxels;
  for (int k = 0; k < kZ; ++k) {
    for (int j = 0; j < kY; ++j) {
      for (int i = 0; i < kX; ++i) voxels.push_back(ValueAt(i, j, k));
    }
  }
  return voxels;
}

Descriptor WrittenFile(LeafType type = LeafType::kInt16) {
  Descriptor file = MakeHandoverFile();
  WriteHandover(file.get(), HeadMetadata(), type, Voxels());
  return file;
}

void ExpectSameMetadata(const VolumeMetadata& is, const VolumeMetadata& expected) {
  EXPECT_EQ(is.size, expected.size);
  EXPECT_EQ(is.spacing_mm, expected.spacing_mm);
  EXPECT_EQ(is.origin_W_mm, expected.origin_W_mm);
  EXPECT_EQ(is.direction, expected.direction);
  EXPECT_EQ(is.value_min, expected.value_min);
  EXPECT_EQ(is.value_max, expected.value_max);
  EXPECT_EQ(is.frames, expected.frames);
  EXPECT_EQ(is.unit, expected.unit);
  EXPECT_EQ(is.window_level, expected.window_level);
  EXPECT_EQ(is.window_width, expected.window_width);
  EXPECT_EQ(is.patient_axes, expected.patient_axes);
  EXPECT_EQ(is.original_type, expected.original_type);
  EXPECT_EQ(is.source, expected.source);
}

TEST(Handover, WhatIsWrittenComesBackInEveryType) {
  for (const LeafType type : kLeafTypes) {
    std::vector<std::pair<Vec3i, std::uint64_t>> told;
    double done = 0.0;
    const LoadedVolume volume =
        TakeHandover(WrittenFile(type).get(),
                     {.on_size =
                          [&](const Vec3i& size, const LoadMemory& memory) {
                            told.emplace_back(size, memory.passing_bytes);
                          },
                      .progress = [&](double fraction) { done = std::max(done, fraction); }});
    EXPECT_EQ(told,
              (std::vector{std::pair(Vec3i(kX, kY, kZ), kX * kY * kZ * VoxelBytes(type) +
                                                            StripBytes({kX, kY, kZ}, type))}));
    EXPECT_LE(done, 1.0);
    ExpectSameMetadata(volume.metadata, HeadMetadata());
    for (int i = 0; i < kX; ++i) {
      for (int j = 0; j < kY; ++j) {
        for (int k = 0; k < kZ; ++k) {
          ASSERT_EQ(volume.bricks.Find(i, j, k).type(), type);
          ASSERT_EQ(volume.bricks.Find(i, j, k)[VoxelInBrick(i, j, k)], ValueAt(i, j, k));
        }
      }
    }
  }
}

TEST(Handover, TextsOfAnyAllowedLengthComeBack) {
  VolumeMetadata metadata = HeadMetadata();
  metadata.unit.clear();
  metadata.source.assign(kLongestText, 'x');
  const Descriptor file = MakeHandoverFile();
  WriteHandover(file.get(), metadata, LeafType::kUint8, Voxels());
  ExpectSameMetadata(TakeHandover(file.get()).metadata, metadata);
  metadata.source += 'x';
  EXPECT_EQ(Refusal([&] { CheckVolumeMetadata(metadata); }), ErrorKind::kInvalidArgument);
}

// Writes, changes the header or the file, and expects a refusal.
void ExpectHeaderRefused(const char* what, const std::function<void(HandoverHeader&)>& change,
                         ErrorKind kind = ErrorKind::kInvalidArgument) {
  const Descriptor file = WrittenFile();
  HandoverHeader header;
  ASSERT_EQ(pread(file.get(), &header, sizeof header, 0), ssize_t{sizeof header});
  change(header);
  ASSERT_EQ(pwrite(file.get(), &header, sizeof header, 0), ssize_t{sizeof header});
  EXPECT_EQ(Refusal([&] { TakeHandover(file.get()); }), kind) << what;
}

TEST(Handover, LiesOfTheHeaderAreRefused) {
  using Header = HandoverHeader;
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  constexpr std::int32_t kMost = std::numeric_limits<std::int32_t>::max();
  ExpectHeaderRefused("magic", [](Header& h) { h.magic[7] = '1'; });
  ExpectHeaderRefused("type", [](Header& h) { h.type = 4; });
  ExpectHeaderRefused("type", [](Header& h) { h.type = 0xffffffff; });
  ExpectHeaderRefused("a wider type",
                      [](Header& h) { h.type = static_cast<int>(LeafType::kFloat); });
  ExpectHeaderRefused("a narrower type", [](Header& h) { h.type = 0; });
  ExpectHeaderRefused("one more", [](Header& h) { ++h.size[0]; });
  ExpectHeaderRefused("one less", [](Header& h) { --h.size[2]; });
  ExpectHeaderRefused("none", [](Header& h) { h.size[1] = 0; });
  ExpectHeaderRefused("negative", [](Header& h) { h.size[0] = h.size[1] = -kX; });
  ExpectHeaderRefused("too long", [](Header& h) { h.size[0] = kMost; });
  ExpectHeaderRefused(
      "too many", [](Header& h) { h.size[0] = h.size[1] = h.size[2] = kMost / 2; },
      ErrorKind::kTooLarge);
  // 2^62 · 4 bytes and the like, which overflow to small numbers.
  ExpectHeaderRefused(
      "overflow", [](Header& h) { h.size[0] = h.size[1] = h.size[2] = 1 << 22; },
      ErrorKind::kTooLarge);
  ExpectHeaderRefused("spacing", [](Header& h) { h.spacing_mm[1] = 0.0; });
  ExpectHeaderRefused("spacing", [](Header& h) { h.spacing_mm[2] = kNoNumber; });
  ExpectHeaderRefused("origin", [](Header& h) { h.origin_W_mm[0] = kNoNumber; });
  ExpectHeaderRefused("direction", [](Header& h) { h.direction[4] = 0.5; });
  ExpectHeaderRefused("patient axes", [](Header& h) { h.patient_axes[1] = 'L'; });
  ExpectHeaderRefused("frames", [](Header& h) { h.frames = 0; });
  ExpectHeaderRefused("range", [](Header& h) { h.value_max = h.value_min; });
  ExpectHeaderRefused("range", [](Header& h) { h.value_min = kNoNumber; });
  ExpectHeaderRefused("not the least", [](Header& h) { h.value_min = -1.0; });
  ExpectHeaderRefused("not the greatest", [](Header& h) { h.value_max = 99.0; });
  ExpectHeaderRefused("unit without an end",
                      [](Header& h) { std::memset(h.unit, 'x', sizeof h.unit); });
  ExpectHeaderRefused("source", [](Header& h) { std::memset(h.source, 'x', sizeof h.source); });
  ExpectHeaderRefused("type's name",
                      [](Header& h) { std::memset(h.original_type, 'x', sizeof h.original_type); });
}

TEST(Handover, FilesOfAnotherLengthAreRefused) {
  const off_t whole = kHandoverVoxels + kX * kY * kZ * 2;
  for (const off_t length : {off_t{0}, off_t{1}, off_t{sizeof(HandoverHeader) - 1},
                             off_t{kHandoverVoxels}, whole - 1, whole + 1, whole * 2}) {
    const Descriptor file = WrittenFile();
    ASSERT_EQ(ftruncate(file.get(), length), 0);
    EXPECT_EQ(Refusal([&] { TakeHandover(file.get()); }), ErrorKind::kInvalidArgument) << length;
  }
  EXPECT_EQ(Refusal([] { TakeHandover(MakeHandoverFile().get()); }), ErrorKind::kInvalidArgument);
}

TEST(Handover, VoxelsThatAreNoNumbersAreRefused) {
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), 1e30f}) {
    const Descriptor file = WrittenFile(LeafType::kFloat);
    ASSERT_EQ(pwrite(file.get(), &bad, sizeof bad, kHandoverVoxels + 4 * 777), ssize_t{sizeof bad});
    EXPECT_EQ(Refusal([&] { TakeHandover(file.get()); }), ErrorKind::kInvalidArgument) << bad;
  }
}

TEST(Handover, WhatCanStillBeWrittenIsRefused) {
  const Descriptor file = WrittenFile();
  void* const map = mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, file.get(), 0);
  ASSERT_NE(map, MAP_FAILED);
  EXPECT_EQ(Refusal([&] { TakeHandover(file.get()); }), ErrorKind::kInvalidArgument);
  munmap(map, 4096);
}

TEST(Handover, NothingCanChangeItOnceItIsTaken) {
  const Descriptor file = WrittenFile();
  const Descriptor other(fcntl(file.get(), F_DUPFD_CLOEXEC, 3));
  TakeHandover(file.get(), {.on_size = [&](const Vec3i&, const LoadMemory&) {
                 // By somebody who still holds it, at the worst moment.
                 char byte = 1;
                 EXPECT_LT(pwrite(other.get(), &byte, 1, 0), 0);
                 EXPECT_LT(ftruncate(other.get(), 0), 0);
                 EXPECT_LT(ftruncate(other.get(), 1 << 20), 0);
                 EXPECT_EQ(mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, other.get(), 0),
                           MAP_FAILED);
               }});
}

TEST(Handover, FilesThatCannotBeSealedAreRefused) {
  FILE* const file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  WriteHandover(fileno(file), HeadMetadata(), LeafType::kInt16, Voxels());
  EXPECT_EQ(Refusal([&] { TakeHandover(fileno(file)); }), ErrorKind::kInvalidArgument);
  std::fclose(file);
}

TEST(Handover, TheLimitAndTheListenerComeBeforeTheMemory) {
  const auto refusal = [](const TakeOptions& options) {
    return Refusal([&] { TakeHandover(WrittenFile().get(), options); });
  };
  const auto no_room = [](const Vec3i&, const LoadMemory&) {
    throw Error(ErrorKind::kTooLarge, "no room");
  };
  const auto enough = [](double) { throw Error(ErrorKind::kCancelled, "enough"); };
  EXPECT_EQ(refusal({.max_voxels = kX * kY * kZ - 1}), ErrorKind::kTooLarge);
  EXPECT_EQ(refusal({.on_size = no_room}), ErrorKind::kTooLarge);
  EXPECT_EQ(refusal({.progress = enough}), ErrorKind::kCancelled);
}

}  // namespace
}  // namespace palpate
