// What the window remembers comes back, and a damaged file never stops a start.
#include "client/view/viewer/preferences.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>

#include "common/error/error.h"

namespace palpate::view {
namespace {

namespace fs = std::filesystem;

const Preferences kOther{.theme = Theme::kLight,
                         .font_percent = 150,
                         .left_width_px = 345.5,
                         .right_width_px = 222.0,
                         .left_shown = false,
                         .right_shown = false,
                         .narrow_side = Side::kRight,
                         .plots_shown = true,
                         .tab = LeftTab::kEdit,
                         .recent_files = {"/data/CT", "/data/a b.nrrd"},
                         .slice_side = SliceSide::kNeurological};

class ViewPreferences : public ::testing::Test {
 protected:
  ViewPreferences() {
    std::string name = (fs::temp_directory_path() / "palpate.XXXXXX").string();
    folder_ = mkdtemp(name.data());
    file_ = folder_ / "state" / "palpate" / "view.json";
  }
  ~ViewPreferences() override { fs::remove_all(folder_); }

  Preferences ReadOf(const std::string& content) const {
    fs::create_directories(file_.parent_path());
    std::ofstream(file_, std::ios::binary) << content;
    return ReadPreferences(file_);
  }
  std::string Written() const {
    std::ostringstream content;
    content << std::ifstream(file_, std::ios::binary).rdbuf();
    return content.str();
  }

  fs::path folder_;
  fs::path file_;
};

TEST_F(ViewPreferences, ComeBackAndReplaceTheOnesBefore) {
  EXPECT_EQ(ReadPreferences(file_), Preferences());
  WritePreferences(kOther, file_);
  EXPECT_EQ(ReadPreferences(file_), kOther);
  WritePreferences({}, file_);
  EXPECT_EQ(ReadPreferences(file_), Preferences());
  // Nothing is left of the files before.
  EXPECT_EQ(std::distance(fs::directory_iterator(file_.parent_path()), {}), 1);
}

TEST_F(ViewPreferences, SavedViewsComeBackWithTheirVolumes) {
  Preferences preferences;
  preferences.saved_views = {{"head.nrrd", {{.name = "one"}, {.name = "two"}}},
                             {"other \"volume\"", {{.name = ""}}}};
  WritePreferences(preferences, file_);
  EXPECT_EQ(ReadPreferences(file_), preferences);
  // A damaged view leaves the others.
  std::string content = Written();
  content.replace(content.find("\"one\""), 5, "12345");
  EXPECT_EQ(ReadOf(content).saved_views["head.nrrd"].size(), 1u);
}

SavedView ViewOf(std::string name, std::int64_t saved_s) {
  SavedView view{.name = std::move(name)};
  view.saved_s = saved_s;
  return view;
}

TEST_F(ViewPreferences, OfTwoWindowsAreThoseThatEachHasChanged) {
  Preferences begun = kOther;
  begun.saved_views = {{"head", {ViewOf("a", 1)}}, {"lobster", {ViewOf("b", 2)}}};
  WritePreferences(begun, file_);
  Preferences one = begun;
  one.theme = Theme::kDark;
  one.saved_views["head"].push_back(ViewOf("c", 3));
  PutFirst("/data/one", one.recent_files);
  WriteChanges(begun, one, file_);
  Preferences other = begun;
  other.left_width_px = 500.0;
  other.saved_views["lobster"].clear();
  other.saved_views["gyroid"] = {ViewOf("d", 4)};
  PutFirst("/data/a b.nrrd", other.recent_files);
  const Preferences written = WriteChanges(begun, other, file_);

  Preferences expected = one;
  expected.left_width_px = 500.0;
  expected.recent_files = {"/data/a b.nrrd", "/data/one", "/data/CT"};
  expected.saved_views.erase("lobster");
  expected.saved_views["gyroid"] = other.saved_views["gyroid"];
  EXPECT_EQ(ReadPreferences(file_), expected);
  EXPECT_EQ(written.recent_files, expected.recent_files);
  // A window that has changed nothing changes nothing.
  WriteChanges(begun, begun, file_);
  EXPECT_EQ(ReadPreferences(file_), expected);
}

TEST_F(ViewPreferences, OfAFileThatIsGoneAreAllOfTheWindow) {
  Preferences before = kOther;
  before.theme = Theme::kDark;
  WriteChanges(before, kOther, file_);
  EXPECT_EQ(ReadPreferences(file_), kOther);
  std::ofstream(file_) << "{";
  WriteChanges(before, kOther, file_);
  EXPECT_EQ(ReadPreferences(file_), kOther);
}

TEST_F(ViewPreferences, ThatAreTooManyLoseTheViewsThatWereSavedFirst) {
  Preferences many = kOther;
  for (int source = 0; source < 12; ++source) {
    // Not in the order of their names.
    auto& views = many.saved_views["volume " + std::to_string(source)];
    for (int n = 0; n < 100; ++n) views.push_back(ViewOf("a", 1000 + (5 * source) % 12));
  }
  WritePreferences(many, file_);
  Preferences read = ReadPreferences(file_);
  EXPECT_TRUE(read.saved_views.contains("volume 7"));   // the newest
  EXPECT_FALSE(read.saved_views.contains("volume 0"));  // the oldest
  EXPECT_GT(read.saved_views.size(), 2u);
  read.saved_views = many.saved_views;
  EXPECT_EQ(read, many);
}

TEST_F(ViewPreferences, OfADamagedFileAreTheDefaults) {
  for (const char* content : {"", "{", "[1, 2]", "null", "17", "\"dark\"", "\xff\xfe\0", "{}"}) {
    EXPECT_EQ(ReadOf(content), Preferences()) << content;
  }
  WritePreferences(kOther, file_);
  const std::string whole = Written();
  for (std::size_t bytes = 0; bytes + 2 < whole.size(); ++bytes) {
    EXPECT_EQ(ReadOf(whole.substr(0, bytes)), Preferences()) << bytes;
  }
}

TEST_F(ViewPreferences, OfRandomBytesArePossible) {
  WritePreferences(kOther, file_);
  const std::string whole = Written();
  std::mt19937 random(7);
  for (int n = 0; n < 300; ++n) {
    std::string content = whole;
    for (int change = 0; change < 3; ++change)
      content[random() % content.size()] = static_cast<char>(random() % 256);
    const Preferences read = ReadOf(content);
    EXPECT_TRUE(read.font_percent >= kLeastFont_percent && read.font_percent <= kMostFont_percent);
    for (const double width_px : {read.left_width_px, read.right_width_px})
      EXPECT_TRUE(width_px >= kLeastSide_px && width_px <= kMostSide_px);
  }
}

TEST_F(ViewPreferences, AValueThatIsNotPossibleLeavesTheOthers) {
  Preferences expected;
  expected.theme = Theme::kLight;
  EXPECT_EQ(ReadOf(R"({"theme": "light", "font_percent": 1e300, "left_width_px": -3,
                       "right_width_px": "wide", "left_shown": 1, "plots_shown": null,
                       "narrow_side": "up", "tab": 3, "recent_files": [3, {}], "from a later version": {"a": [1]}})"),
            expected);
}

TEST_F(ViewPreferences, AreNoPipeAndNoFolder) {
  fs::create_directories(file_);
  EXPECT_EQ(ReadPreferences(file_), Preferences());
  EXPECT_THROW(WritePreferences(kOther, file_), Error);
  fs::remove(file_);
  ASSERT_EQ(mkfifo(file_.c_str(), 0600), 0);
  EXPECT_EQ(ReadPreferences(file_), Preferences());
  EXPECT_THROW(WritePreferences(kOther, file_), Error);
}

TEST(ViewRecentFiles, HaveTheNewestFirstAndOnce) {
  std::vector<std::string> files;
  for (int n = 0; n < 12; ++n) PutFirst("/data/" + std::to_string(n % 10), files);
  EXPECT_EQ(files.size(), kMostRecentFiles);
  EXPECT_EQ(files.front(), "/data/1");
  EXPECT_EQ(std::count(files.begin(), files.end(), "/data/1"), 1);
}

// A file where the folder should be: that holds for root, too.
TEST_F(ViewPreferences, SayWhenTheFolderCannotBeWritten) {
  std::ofstream(folder_ / "state") << "no folder";
  EXPECT_THROW(WritePreferences(kOther, file_), Error);
  EXPECT_EQ(ReadPreferences(file_), Preferences());
}

TEST(ViewPreferencesFile, IsInTheStateFolderOfTheUser) {
  setenv("XDG_STATE_HOME", "/a/state", 1);
  EXPECT_EQ(PreferencesFile(), "/a/state/palpate/view.json");
  // The standard says that a relative one does not count.
  setenv("XDG_STATE_HOME", "state", 1);
  setenv("HOME", "/home/ada", 1);
  EXPECT_EQ(PreferencesFile(), "/home/ada/.local/state/palpate/view.json");
  unsetenv("XDG_STATE_HOME");
  EXPECT_EQ(PreferencesFile(), "/home/ada/.local/state/palpate/view.json");
  unsetenv("HOME");
  EXPECT_EQ(PreferencesFile(), "");
}

}  // namespace
}  // namespace palpate::view
