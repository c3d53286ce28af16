// Files that clients send, and files that make a series.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <limits>
#include <vector>

#include "common/error/error.h"
#include "server/client_paths/series_files.h"
#include "server/client_paths/upload.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using testing::Refusal;

TEST(ComesBefore, OrdersByTheNumbersInTheNames) {
  for (const auto& [first, second] : std::vector<std::pair<std::string, std::string>>{
           {"t9", "t10"},
           {"t010", "t20"},
           {"t2_9", "t2_11"},
           {"t1", "t1x"},
           {"a01b3", "a2"},
           {"a99999999999999999998", "a99999999999999999999"}}) {
    EXPECT_TRUE(ComesBefore(first, second)) << first;
  }
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

// Of "123456789", as every description of CRC-32 gives it.
constexpr std::uint32_t kCheck = 0xcbf43926;

class UploadTest : public ::testing::Test {
 protected:
  void TearDown() override {
    EXPECT_TRUE(fs::is_empty(folder_.path()));
    EXPECT_EQ(budget_->held_bytes(), 0u);
  }
  std::optional<ErrorKind> RefusalOf(const UploadStart& start) {
    return Refusal([&] { Upload(options_, *budget_, start); });
  }

  test::TemporaryFolder folder_;
  UploadOptions options_{.folder = folder_.path(), .max_bytes = 100};
  std::shared_ptr<MemoryBudget> budget_ = MemoryBudget::Make(100);
};

TEST_F(UploadTest, IsAFileOfItsNameThatNobodyElseCanReach) {
  Upload upload(options_, *budget_, {.name = "a b.nrrd", .size_bytes = 9, .crc32 = kCheck});
  for (const char* part : {"1234", "", "5678", "9"}) upload.Append(part);
  upload.Finish();
  EXPECT_EQ(upload.path().filename(), "a b.nrrd");
  EXPECT_EQ(upload.title(), "upload:a b.nrrd");
  EXPECT_EQ(test::TextOf(upload.path()), "123456789");
  struct stat status {};
  stat(upload.path().parent_path().c_str(), &status);
  EXPECT_EQ(status.st_mode & 0777, 0700u);
  EXPECT_EQ(budget_->held_bytes(), 9u);
}

TEST_F(UploadTest, AnotherSizeOrChecksumIsRefused) {
  const UploadStart start{.name = "a.nrrd", .size_bytes = 9, .crc32 = kCheck};
  EXPECT_EQ(Refusal([&] { Upload(options_, *budget_, start).Append("1234567890"); }),
            ErrorKind::kInvalidArgument);
  for (const char* bytes : {"", "12345678", "12345678X"}) {
    Upload upload(options_, *budget_, start);
    upload.Append(bytes);
    EXPECT_EQ(Refusal([&] { upload.Finish(); }), ErrorKind::kInvalidArgument) << bytes;
  }
  UploadStart wrong = start;
  wrong.crc32 = 0;
  Upload upload(options_, *budget_, wrong);
  upload.Append("123456789");
  EXPECT_EQ(Refusal([&] { upload.Finish(); }), ErrorKind::kInvalidArgument);
}

TEST_F(UploadTest, AFolderHasItsFiles) {
  const UploadStart start{.name = "CT",
                          .size_bytes = 9,
                          .crc32 = kCheck,
                          .files = {{"a", 4}, {"none", 0}, {"b.dcm", 5}, {"last", 0}}};
  Upload upload(options_, *budget_, start);
  for (const char* part : {"12", "345678", "9"}) upload.Append(part);
  EXPECT_EQ(Refusal([&] { upload.Append("0"); }), ErrorKind::kInvalidArgument);
  upload.Finish();
  EXPECT_EQ(test::TextOf(upload.path() / "a"), "1234");
  EXPECT_EQ(test::TextOf(upload.path() / "b.dcm"), "56789");
}

TEST_F(UploadTest, AFolderThatMakesNoSenseIsRefused) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();
  for (const std::vector<UploadFile>& files : std::vector<std::vector<UploadFile>>{
           {{"../a", 9}},
           {{"", 9}},
           {{"a/b", 9}},
           {{"a", 8}},
           {{"a", 10}},
           {{"a", kMost}, {"b", 10}},  // wraps to 9
           {{"a", 9}, {"b", kMost}, {"c", 1}},
       }) {
    EXPECT_EQ(RefusalOf({.name = "CT", .size_bytes = 9, .files = files}),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(RefusalOf({.name = "CT", .size_bytes = 9, .files = std::vector<UploadFile>(65'537)}),
            ErrorKind::kTooLarge);
  const UploadStart twice{
      .name = "CT", .size_bytes = 9, .crc32 = kCheck, .files = {{"a", 4}, {"a", 5}}};
  EXPECT_EQ(Refusal([&] { Upload(options_, *budget_, twice).Append("123456789"); }),
            ErrorKind::kInvalidArgument);
}

TEST_F(UploadTest, VdbFilesCanBeSwitchedOff) {
  EXPECT_EQ(RefusalOf({.name = "a.vdb", .size_bytes = 9}), std::nullopt);
  options_.vdb = false;
  for (const char* name : {"a.vdb", "A.VDB", ".vdb"}) {
    EXPECT_EQ(RefusalOf({.name = name, .size_bytes = 9}), ErrorKind::kPermissionDenied) << name;
  }
  EXPECT_EQ(RefusalOf({.name = "vdb.nrrd", .size_bytes = 9}), std::nullopt);
  EXPECT_EQ(RefusalOf({.name = "a.vdb", .size_bytes = 9, .holds_voxels = true}), std::nullopt);
}

TEST_F(UploadTest, TheNameIsThatOfAFile) {
  for (const std::string& bad :
       {std::string(), std::string("."), std::string(".."), std::string("/"),
        std::string("a/b.nrrd"), std::string("../a.nrrd"), std::string("/tmp/a.nrrd"),
        std::string("a\0b.nrrd", 8), std::string("a\nb.nrrd"), std::string("a\x7f.nrrd"),
        std::string(201, 'a'), std::string("a.nhdr"), std::string("a.MHD")}) {
    EXPECT_EQ(RefusalOf({.name = bad, .size_bytes = 9}), ErrorKind::kInvalidArgument) << bad;
  }
  for (const std::string& good :
       {std::string("-"), std::string("...nrrd"), std::string("..a"), std::string("a\\b.nrrd"),
        std::string("ä.nrrd"), std::string(200, 'a')}) {
    EXPECT_EQ(RefusalOf({.name = good, .size_bytes = 9}), std::nullopt) << good;
  }
  EXPECT_EQ(RefusalOf({.name = "a.mhd", .size_bytes = 9, .holds_voxels = true}), std::nullopt);
}

TEST_F(UploadTest, TheSizeHasBounds) {
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 0}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 100}), std::nullopt);
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 101}), ErrorKind::kTooLarge);
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = ~std::uint64_t{0}}), ErrorKind::kTooLarge);
  const Upload first(options_, *budget_, {.name = "a", .size_bytes = 60});
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 41}), ErrorKind::kTooLarge);
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 40}), std::nullopt);
}

TEST_F(UploadTest, TwoOfOneNameDoNotMeet) {
  const UploadStart start{.name = "a", .size_bytes = 9, .crc32 = kCheck};
  Upload first(options_, *budget_, start);
  Upload second(options_, *budget_, start);
  first.Append("12345");
  second.Append("123456789");
  first.Append("6789");
  first.Finish();
  second.Finish();
  EXPECT_NE(first.path(), second.path());
}

TEST_F(UploadTest, AFolderThatIsNotThereIsUnavailable) {
  options_.folder = folder_.path() / "none";
  EXPECT_EQ(RefusalOf({.name = "a", .size_bytes = 1}), ErrorKind::kUnavailable);
}

TEST_F(UploadTest, AFullDiskIsSaid) {
  // A limit of file sizes stands for it.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{4, before.rlim_max};
  Upload upload(options_, *budget_, {.name = "a", .size_bytes = 9, .crc32 = kCheck});
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_EQ(Refusal([&] { upload.Append("123456789"); }), ErrorKind::kDiskFull);
  setrlimit(RLIMIT_FSIZE, &before);
}

TEST_F(UploadTest, LeftoversOfTheDeadAreRemovedAndNoOthers) {
  // A process that has ended.
  const pid_t child = fork();
  if (child == 0) _exit(0);
  waitpid(child, nullptr, 0);
  const std::string dead = "palpate-upload-" + std::to_string(child) + "-abcdef";
  const std::string alive = "palpate-upload-" + std::to_string(getpid()) + "-abcdef";
  for (const std::string& name :
       {dead, alive, std::string("palpate-upload-"), std::string("palpate-upload-x"),
        std::string("other-") + std::to_string(child)}) {
    fs::create_directory(folder_.path() / name);
  }
  std::ofstream(folder_.path() / dead / "a.nrrd") << "x";
  RemoveAbandonedUploads(options_);
  EXPECT_FALSE(fs::exists(folder_.path() / dead));
  int left = 0;
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    ++left;
    fs::remove(entry);
  }
  EXPECT_EQ(left, 4);
}

}  // namespace
}  // namespace palpate
