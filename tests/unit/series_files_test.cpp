// Which files make a series, and in which order.
#include "server/session/series_files.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "common/error/error.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using testing::Refusal;

TEST(ComesBefore, OrdersByTheNumbersInTheNames) {
  EXPECT_TRUE(ComesBefore("t9", "t10"));
  EXPECT_TRUE(ComesBefore("t010", "t20"));
  EXPECT_TRUE(ComesBefore("t2_9", "t2_11"));
  EXPECT_TRUE(ComesBefore("a99999999999999999998", "a99999999999999999999"));
  EXPECT_TRUE(ComesBefore("t1", "t1x"));
  EXPECT_TRUE(ComesBefore("a01b3", "a2"));
}

TEST(ComesBefore, IsAStrictOrder) {
  std::vector<std::string> names;
  for (const char* head : {"", "a", "0", "00", "1", "a1", "a01"}) {
    for (const char* tail : {"", "0", "b", "1", "10", "-"}) {
      names.push_back(std::string(head) + tail);
    }
  }
  for (const auto& a : names) {
    for (const auto& b : names) {
      EXPECT_EQ(ComesBefore(a, b) || ComesBefore(b, a), a != b) << a << " " << b;
      for (const auto& c : names) {
        if (ComesBefore(a, b) && ComesBefore(b, c)) {
          EXPECT_TRUE(ComesBefore(a, c)) << a << " " << b << " " << c;
        }
      }
    }
  }
}

class SeriesFilesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"in", "out"}) fs::create_directory(root_ / name);
    policy_ = PathPolicy({.load_folders = {root_ / "in"}});
    for (const char* name :
         {"in/t10.nrrd", "in/t9.nrrd", "in/t100.nrrd", "in/u1.nrrd", "in/.t5.nrrd", "in/t[1].nii",
          "in/t1.nii", "in/tx.nii", "out/t1.nrrd"}) {
      std::ofstream(root_ / name) << "x";
    }
  }
  std::vector<std::string> Find(const std::vector<std::string>& names) const {
    std::vector<std::string> sources;
    for (const std::string& name : names) sources.push_back(root_ / name);
    std::vector<std::string> found;
    for (const fs::path& path : FindSeriesFiles(sources, policy_)) {
      found.push_back(path.lexically_relative(root_));
    }
    return found;
  }
  std::optional<ErrorKind> RefusalOf(const std::vector<std::string>& sources) const {
    return Refusal([&] { FindSeriesFiles(sources, policy_); });
  }
  using Names = std::vector<std::string>;

  test::TemporaryFolder folder_;
  const fs::path root_ = fs::canonical(folder_.path());
  PathPolicy policy_;
};

TEST_F(SeriesFilesTest, PatternsComeByNumberAndListsAsTheyAre) {
  EXPECT_EQ(Find({"in/t*.nrrd"}), (Names{"in/t9.nrrd", "in/t10.nrrd", "in/t100.nrrd"}));
  EXPECT_EQ(Find({"in/t?.nrrd"}), (Names{"in/t9.nrrd"}));
  EXPECT_EQ(Find({"in/t??.nrrd", "in/t9.nrrd"}), (Names{"in/t10.nrrd", "in/t9.nrrd"}));
  EXPECT_EQ(Find({"in/u1.nrrd", "in/t9.nrrd"}), (Names{"in/u1.nrrd", "in/t9.nrrd"}));
  EXPECT_EQ(Find({"in/../in/t9*"}), (Names{"in/t9.nrrd"}));
  // Whoever opens it says that it is not there.
  EXPECT_EQ(Find({"in/absent.nrrd"}), (Names{"in/absent.nrrd"}));
}

TEST_F(SeriesFilesTest, OnlyStarsAndQuestionMarksAreSpecial) {
  EXPECT_EQ(Find({"in/t[1]*"}), (Names{"in/t[1].nii"}));
  EXPECT_EQ(Find({"in/t[1].nii"}), (Names{"in/t[1].nii"}));
  std::ofstream(root_ / "in/b\\s1") << "x";
  EXPECT_EQ(Find({"in/b\\s?"}), (Names{"in/b\\s1"}));
  // Hidden files are not meant.
  EXPECT_EQ(RefusalOf({root_ / "in/*5.nrrd"}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(Find({"in/.*5.nrrd"}), (Names{"in/.t5.nrrd"}));
}

TEST_F(SeriesFilesTest, BadSourcesAreRefused) {
  EXPECT_EQ(RefusalOf({}), ErrorKind::kInvalidArgument);
  for (const std::string& bad :
       {std::string(), std::string("t*.nrrd"), std::string("in/t9.nrrd"),
        (root_ / "in/v*").string(), (root_ / "in/*5.nrrd").string(),
        (root_ / "i?/t9.nrrd").string(), std::string("builtin:bumps"), std::string("builtin:*"),
        (root_ / "in/t").string() + '\0' + "*"}) {
    EXPECT_EQ(RefusalOf({bad}), ErrorKind::kInvalidArgument) << bad;
    EXPECT_EQ(RefusalOf({root_ / "in/t9.nrrd", bad}), ErrorKind::kInvalidArgument) << bad;
  }
}

TEST_F(SeriesFilesTest, PatternsDoNotLookElsewhere) {
  fs::create_symlink(root_ / "out/t1.nrrd", root_ / "in/w1.nrrd");
  fs::create_symlink(root_ / "out", root_ / "in/way_out");
  for (const char* bad : {"out/t*", "out/none*", "in/w*", "in/way_out/*", "in/../out/t?.nrrd"}) {
    EXPECT_EQ(RefusalOf({root_ / bad}), ErrorKind::kPermissionDenied) << bad;
  }
}

TEST_F(SeriesFilesTest, TooManyFramesAreRefused) {
  const std::vector<std::string> sources(kMostFrames + 1, root_ / "in/t9.nrrd");
  EXPECT_EQ(RefusalOf(sources), ErrorKind::kTooLarge);
}

}  // namespace
}  // namespace palpate
