// The ticks before a fault are kept.
#include "server/recording/black_box.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

std::vector<std::string> LinesOf(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

class BlackBoxTest : public ::testing::Test {
 protected:
  BlackBoxTest() { box_.Start(); }

  void Tick(ProxyMode mode = ProxyMode::kFree, ForceState state = ForceState::kOn,
            ForceReason reason = ForceReason::kNone) {
    TickSample sample;
    sample.tick = tick_;
    sample.time_ns = 1'000'000 * static_cast<std::int64_t>(tick_++);
    sample.mode = mode;
    sample.force_state = state;
    sample.force_reason = reason;
    box_.OnSample(sample);
  }
  void Ticks(int count) {
    for (int n = 0; n < count; ++n) Tick();
  }
  void Fault() { Tick(ProxyMode::kFault, ForceState::kFault, ForceReason::kDevice); }
  void Stop() { Tick(ProxyMode::kFree, ForceState::kStopped, ForceReason::kStopCall); }

  // After the files that wait are written.
  std::vector<std::filesystem::path> Files() {
    box_.Stop();
    std::vector<std::filesystem::path> files;
    if (!std::filesystem::exists(faults_)) return files;
    for (const auto& entry : std::filesystem::directory_iterator(faults_)) {
      files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    return files;
  }
  void AwaitReports(std::size_t count) {
    EXPECT_TRUE(test::Eventually([&] { return reported_ >= count; }));
  }

  test::TemporaryFolder folder_;
  std::filesystem::path faults_ = folder_.path() / "faults";
  std::vector<std::string> reports_;
  std::atomic<std::size_t> reported_ = 0;
  BlackBox box_{faults_, [this](const std::string& text, bool) {
                  reports_.push_back(text);
                  ++reported_;
                }};
  std::uint64_t tick_ = 0;
};

TEST_F(BlackBoxTest, KeepsTheLastTwoSecondsUpToTheFault) {
  Ticks(5000);
  for (int n = 0; n < 20'000; ++n) Fault();  // it goes on, and is one
  Ticks(10);
  const auto files = Files();
  ASSERT_EQ(files.size(), 1u);
  EXPECT_NE(files[0].filename().string().find("Z-device.csv"), std::string::npos) << files[0];
  const auto lines = LinesOf(files[0]);
  ASSERT_EQ(lines.size(), 2001u);
  EXPECT_TRUE(lines[0].starts_with("tick,time_ns,mode,"));
  EXPECT_NE(lines[0].find(",force_reason,"), std::string::npos);
  EXPECT_TRUE(lines[1].starts_with("3001,")) << lines[1];
  EXPECT_TRUE(lines[2000].starts_with("5000,5000000000,fault,")) << lines[2000];
  EXPECT_NE(lines[2000].find(",fault,device,"), std::string::npos) << lines[2000];
  ASSERT_EQ(reports_.size(), 1u);
  EXPECT_NE(reports_[0].find(files[0].string()), std::string::npos) << reports_[0];
}

// By an isovalue that is swept, or another volume.
TEST_F(BlackBoxTest, AStylusThatTheSurfaceMovedOverIsNoFault) {
  Ticks(10);
  for (int n = 0; n < 100; ++n) Tick(ProxyMode::kInside);
  EXPECT_TRUE(Files().empty());
  EXPECT_TRUE(reports_.empty());
}

TEST_F(BlackBoxTest, NothingLeadsToAFaultInTheFirstTick) {
  for (int n = 0; n < 100; ++n) Fault();
  EXPECT_EQ(Files().size(), 0u);
}

TEST_F(BlackBoxTest, AFaultThatComesAndGoesIsAFileEveryFiveSeconds) {
  Tick();
  std::size_t reports = 0;
  for (int n = 0; n < 100; ++n) {
    Fault();
    Ticks(99);
    // Of ten seconds: two files, and for each one that there was more.
    if (n % 50 < 2) AwaitReports(++reports);
  }
  EXPECT_EQ(Files().size(), 2u);
  EXPECT_EQ(reports_.size(), reports);
}

TEST_F(BlackBoxTest, AnotherReasonIsAnotherFileAtOnce) {
  const std::function<void()> cuts[] = {[&] { Stop(); }, [&] { Fault(); }, [&] { Stop(); }};
  for (std::size_t n = 0; n < 3; ++n) {
    Tick();
    cuts[n]();
    AwaitReports(n + 1);
    // Names go by milliseconds.
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  const auto files = Files();
  ASSERT_EQ(files.size(), 3u);
  EXPECT_NE(files[0].string().find("-device"), std::string::npos);
  EXPECT_TRUE(files[1].filename().string().starts_with("stop-"));
  EXPECT_NE(files[1].string().find("-stop-call"), std::string::npos);
}

TEST_F(BlackBoxTest, TheNewestFilesStay) {
  std::filesystem::create_directories(faults_);
  for (int n = 10; n < 40; ++n) {
    std::ofstream(faults_ / ("fault-202001" + std::to_string(n) + "T000000.000Z-device.csv")) << n;
  }
  std::ofstream(faults_ / "notes.txt") << "of the operator";
  Tick();
  Fault();
  const auto files = Files();
  EXPECT_EQ(files.size(), BlackBox::kMostFiles + 1);
  EXPECT_TRUE(std::filesystem::exists(faults_ / "notes.txt"));
  EXPECT_TRUE(std::filesystem::exists(faults_ / "fault-20200139T000000.000Z-device.csv"));
  EXPECT_FALSE(std::filesystem::exists(faults_ / "fault-20200120T000000.000Z-device.csv"));
}

TEST_F(BlackBoxTest, WhatCannotBeWrittenIsSaid) {
  std::ofstream(faults_) << "a file in its place";
  Tick();
  Fault();
  box_.Stop();
  ASSERT_EQ(reports_.size(), 1u);
  EXPECT_NE(reports_[0].find(faults_.string()), std::string::npos) << reports_[0];
}

TEST(BlackBox, WithoutAFolderNothingIsWritten) {
  BlackBox box("", [](const std::string&, bool) { ADD_FAILURE(); });
  box.Start();
  TickSample sample;
  box.OnSample(sample);
  sample.mode = ProxyMode::kFault;
  box.OnSample(sample);
  box.Stop();
}

}  // namespace
}  // namespace palpate
