// The recordings that a client may list.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "server/recording/recording_control.h"
#include "tests/support/recording_control_rig.h"

namespace palpate {
namespace {

class RecordingListTest : public testing::RecordingControlRig {};

TEST_F(RecordingListTest, RecordingsAreListedByWhatTheyAre) {
  EXPECT_TRUE(control_.Recordings().empty());
  const auto record = [&](const std::string& name, int age_s) {
    control_.Start(File(name), false);
    control_.Stop();
    std::filesystem::last_write_time(
        File(name), std::filesystem::file_time_type::clock::now() - std::chrono::seconds(age_s));
  };
  record("old.mcap", 1000);
  record("no suffix", 10);
  std::filesystem::copy_file(File("no suffix"), File("forbidden"));
  std::ofstream(File("a.mcap")) << "not one, whatever its name";
  std::ofstream(File("empty.mcap")).flush();
  record("\xc3\xa4", 2000);
  for (const char* name : {"\xff", "\xc3", "\xed\xa0\x80", "a\nb"}) record(name, 0);
  std::filesystem::create_directory(File("folder.mcap"));
  std::filesystem::create_symlink("no suffix", File("link"));
  std::filesystem::create_symlink("nowhere", File("broken"));
  EXPECT_EQ(mkfifo(File("pipe").c_str(), 0600), 0);
  std::vector<std::string> names;
  for (const ListedRecording& listed : control_.Recordings()) {
    EXPECT_EQ(listed.size_bytes, std::filesystem::file_size(listed.path));
    names.push_back(listed.path.filename());
  }
  EXPECT_EQ(names, (std::vector<std::string>{"link", "no suffix", "old.mcap", "\xc3\xa4"}));
  EXPECT_EQ(control_.folder(), folder_.path());
  EXPECT_EQ(FolderForNew({}), "");
  EXPECT_EQ(FolderForNew({"/\xff", "/a"}), "");
  EXPECT_EQ(FolderForNew({"/a", "/b"}), "/a");
}

TEST_F(RecordingListTest, OfManyFilesTheNewestAreListed) {
  control_.Start(File("0"), false);
  control_.Stop();
  const auto now = std::filesystem::file_time_type::clock::now();
  std::vector<std::string> names(60);
  for (std::size_t n = 0; n < names.size(); ++n) {
    names[n] = std::to_string(n);
    if (n > 0) std::filesystem::copy_file(File("0"), File(names[n]));
  }
  std::shuffle(names.begin(), names.end(), std::mt19937(1));
  for (std::size_t n = 0; n < names.size(); ++n) {
    std::filesystem::last_write_time(File(names[n]), now - std::chrono::hours(n));
  }
  for (const auto& [recordings, files] :
       {std::pair(100, 1), std::pair(100, 7), std::pair(3, 7), std::pair(100, 59),
        std::pair(100, 60), std::pair(20, 1000), std::pair(0, 5)}) {
    const ListBounds bounds{static_cast<std::size_t>(recordings), static_cast<std::size_t>(files)};
    std::vector<std::string> listed;
    for (const ListedRecording& one :
         FindRecordings({folder_.path()}, testing::OpenAllowed, bounds)) {
      listed.push_back(one.path.filename());
    }
    const std::size_t count = std::min({bounds.recordings, bounds.files, names.size()});
    EXPECT_EQ(listed, std::vector(names.begin(), names.begin() + static_cast<int>(count)));
  }
}

// Some file systems hold times that no calendar has.
TEST_F(RecordingListTest, TimesOfFilesAreWithinTheCalendar) {
  control_.Start(File("a"), false);
  control_.Stop();
  for (const std::int64_t time_s : {-1'000'000'000LL, 1'000'000'000LL, 1'000'000'000'000LL}) {
    const timespec times[2] = {{time_s, 0}, {time_s, 0}};
    ASSERT_EQ(utimensat(AT_FDCWD, File("a").c_str(), times, 0), 0);
    const std::int64_t listed_s = control_.Recordings().at(0).modified_s;
    if (time_s < 0) {
      EXPECT_EQ(listed_s, 0);
    } else if (time_s == 1'000'000'000) {
      EXPECT_EQ(listed_s, time_s);
    } else {
      EXPECT_LE(listed_s, 253'402'300'799);
    }
  }
}

}  // namespace
}  // namespace palpate
