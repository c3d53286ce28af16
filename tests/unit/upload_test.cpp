// Files that clients send, before they reach the importer.
#include "server/session/upload.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <sstream>

#include "common/error/error.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using testing::Refusal;

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
  std::ostringstream text;
  text << std::ifstream(upload.path()).rdbuf();
  EXPECT_EQ(text.str(), "123456789");
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

TEST_F(UploadTest, AFullDiskIsUnavailable) {
  // A limit of file sizes stands for it.
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{4, before.rlim_max};
  Upload upload(options_, *budget_, {.name = "a", .size_bytes = 9, .crc32 = kCheck});
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_EQ(Refusal([&] { upload.Append("123456789"); }), ErrorKind::kUnavailable);
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
