// Recordings on a disk: names, full disks, kill -9, and what a minute costs.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/recording/recording_reader.h"
#include "server/recording/recording_writer.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/recording.h"
#include "tests/support/refusal.h"
#include "tests/support/scaled.h"
#include "tests/support/scene_rig.h"
#include "tests/support/temporary_folder.h"

namespace {

std::atomic<int> syncs{0};
std::uint64_t free_bytes = std::uint64_t{1} << 40;

}  // namespace

// A disk with as much room as the test wants.
extern "C" int statvfs(const char*, struct statvfs* disk) noexcept {
  *disk = {};
  disk->f_frsize = 1;
  disk->f_blocks = std::uint64_t{1} << 41;
  disk->f_bavail = free_bytes;
  return 0;
}

// Counts how often this program asks for its data to be on the disk, and does it.
extern "C" int fdatasync(int file) {
  ++syncs;
  return static_cast<int>(syscall(SYS_fdatasync, file));
}

namespace palpate {
namespace {

using test::Process;
using test::TemporaryFolder;
using testing::RandomSample;
using testing::Refusal;
using testing::SameSample;

void Write(const std::filesystem::path& path, bool overwrite,
           const std::vector<TickSample>& samples) {
  RecordingWriter writer(CreateRecordingFile(path, overwrite), "test");
  testing::Append(writer, samples);
  writer.AppendEnd();
}

void Write(const std::filesystem::path& path, bool overwrite, std::size_t ticks) {
  Write(path, overwrite, testing::RandomSamples(0, ticks));
}

struct FileContents {
  std::uint64_t ticks = 0;
  bool complete = false;
  std::string program{};
};

FileContents Read(const std::filesystem::path& path) {
  RecordingReader reader(path);
  for (const TickSample& sample : testing::SamplesIn(testing::ReadAll(reader))) {
    EXPECT_TRUE(SameSample(sample, RandomSample(sample.tick)));
  }
  return {reader.ticks(), reader.complete(), reader.header().program};
}

std::size_t FilesIn(const std::filesystem::path& folder) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++count;
  return count;
}

TEST(RecordingFile, IsNotOverwrittenUnlessAsked) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.palpate";
  Write(path, false, 3);
  EXPECT_EQ(Refusal([&] { Write(path, false, 4); }), ErrorKind::kConflict);
  EXPECT_EQ(Read(path).ticks, 3u);
  Write(path, true, 5);
  EXPECT_EQ(Read(path).ticks, 5u);
  EXPECT_TRUE(Read(path).complete);
  EXPECT_EQ(FilesIn(folder.path()), 1u);
}

// A power cut costs about the last second, and not every chunk waits for the disk.
TEST(RecordingFile, IsSyncedOnceASecond) {
  const TemporaryFolder folder;
  std::chrono::steady_clock::time_point now{std::chrono::hours(1)};
  const auto output =
      CreateRecordingFile(folder.path() / "a.palpate", false, 0, [&] { return now; });
  output->Append("header");
  const int first = syncs;
  EXPECT_GT(first, 0);
  for (int chunk = 0; chunk < 200; ++chunk) {
    now += std::chrono::milliseconds(100);
    output->Append("chunk");
  }
  EXPECT_GE(syncs - first, 17);  // within 20 s
  EXPECT_LE(syncs - first, 21);
}

// Files may grow to a limit here, as on a disk that fills up.
TEST(RecordingFile, AFullDiskLeavesWholeChunks) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.palpate";
  signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &limit), 0);
  const rlimit unlimited = limit;
  RecordingWriter writer(CreateRecordingFile(path, false), "test");
  const auto append = [&](std::uint64_t tick) {
    testing::Append(writer, std::vector{RandomSample(tick)});
  };
  append(0);
  limit.rlim_cur = writer.counts().bytes + 100;  // part of a chunk
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const std::optional<ErrorKind> refusal = Refusal([&] { append(1); });
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
  EXPECT_EQ(refusal, ErrorKind::kDiskFull);
  EXPECT_EQ(std::filesystem::file_size(path), writer.counts().bytes);
  EXPECT_EQ(Read(path).ticks, 1u);
  writer.EndChunk();  // there is space again
  writer.AppendEnd();
  EXPECT_EQ(Read(path).ticks, 2u);
  EXPECT_TRUE(Read(path).complete);
}

TEST(RecordingFile, NoneBeginsOnADiskThatIsNearlyFull) {
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.palpate";
  const std::uint64_t before = std::exchange(free_bytes, kLeastRoomBytes - 1);
  EXPECT_EQ(Refusal([&] { CreateRecordingFile(path, false); }), ErrorKind::kDiskFull);
  EXPECT_EQ(FilesIn(folder.path()), 0u);
  free_bytes = kLeastRoomBytes;
  EXPECT_NE(CreateRecordingFile(path, false), nullptr);
  EXPECT_EQ(Refusal([&] { CreateRecordingFile(path, false, 1); }), ErrorKind::kDiskFull);
  free_bytes = before;
}

// The last number after "ticks " on a whole line.
std::uint64_t LastTicks(const std::string& output) {
  const std::size_t line = output.rfind("ticks ", output.rfind('\n'));
  return line == std::string::npos ? 0 : std::stoull(output.substr(line + 6));
}

TEST(RecordingFile, OfAKilledProgramIsReadableToItsLastChunk) {
  for (int round = 0; round < 3; ++round) {
    const TemporaryFolder folder;
    const auto path = folder.path() / "a.palpate";
    Process child({test::kRecordingChild, path.string()});
    ASSERT_TRUE(child.WaitFor("under way"));
    std::this_thread::sleep_for(std::chrono::milliseconds(7 * round));
    child.Signal(SIGKILL);
    const std::uint64_t told = LastTicks(child.Wait().output);
    const FileContents contents = Read(path);
    EXPECT_GE(told, 1000u);
    EXPECT_GE(contents.ticks, told);
    EXPECT_FALSE(contents.complete);
    EXPECT_EQ(FilesIn(folder.path()), 1u);
  }
}

TEST(RecordingFile, KilledWhileOverwritingIsTheOldOneOrTheNew) {
  int old_ones = 0, new_ones = 0;
  for (int round = 0; round < 24; ++round) {
    const TemporaryFolder folder;
    const auto path = folder.path() / "a.palpate";
    Write(path, false, 3);
    Process child({test::kRecordingChild, path.string(), "overwrite"});
    // Somewhere on the way, at its beginning, or after the new one has its name.
    std::this_thread::sleep_for(std::chrono::microseconds(500 * round));
    const bool is_begun = round % 4 == 0 && child.WaitFor("ticks");
    child.Signal(SIGKILL);
    child.Wait();
    const FileContents contents = Read(path);
    const bool is_old = contents.program == "test";
    EXPECT_EQ(contents.complete, is_old);
    EXPECT_TRUE(!is_old || (contents.ticks == 3 && !is_begun));
    ++(is_old ? old_ones : new_ones);
  }
  EXPECT_GT(old_ones, 0);
  EXPECT_GT(new_ones, 0);
}

// The gyroid as the simulated device feels it; each tick starts up to 16 us late.
TEST(RecordingFile, AMinuteIsCompact) {
  const std::size_t ticks = static_cast<std::size_t>(test::Scaled(20'000));
  testing::SceneRig rig(testing::Gyroid());
  rig.Set(0.5, {});
  std::vector<TickSample> samples;
  std::size_t contacts = 0;
  for (std::size_t tick = 0; tick < ticks; ++tick) {
    const std::int64_t time_ns = static_cast<std::int64_t>(tick) * 1'000'000;
    const std::int64_t late_ns = static_cast<std::int64_t>(tick * 7919 % 16384);
    samples.push_back(rig.Tick({.scheduled_ns = time_ns, .started_ns = time_ns + late_ns}));
    contacts += samples.back().contact;
  }
  EXPECT_GT(contacts, ticks / 2);
  const TemporaryFolder folder;
  const auto path = folder.path() / "a.palpate";
  Write(path, false, samples);
  const double bytes = static_cast<double>(std::filesystem::file_size(path));
  EXPECT_LT(bytes / static_cast<double>(ticks), 180.0);
}

}  // namespace
}  // namespace palpate
