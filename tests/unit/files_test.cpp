// Files that are whole or as they were, files that a user names, programs beside this one, and
// numbers as text.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <thread>

#include "common/error/text.h"
#include "common/files/child_process.h"
#include "common/files/new_file.h"
#include "common/files/text_file.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

// As on a file system that cannot rename without replacing (NFS): this program's renameat2 refuses.
bool is_without_noreplace = false, is_without_rename = false;

extern "C" int renameat2(int from_folder, const char* from, int to_folder, const char* to,
                         unsigned flags) noexcept {
  if ((is_without_noreplace && flags != 0) || is_without_rename) {
    errno = flags != 0 ? EINVAL : EIO;
    return -1;
  }
  return static_cast<int>(syscall(SYS_renameat2, from_folder, from, to_folder, to, flags));
}

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::TextOf;
using testing::Refusal;

class NewFileTest : public ::testing::Test {
 protected:
  int Files() const {
    return static_cast<int>(std::distance(fs::directory_iterator(folder_.path()), {}));
  }

  const test::TemporaryFolder folder_;
  const fs::path path_ = folder_.path() / "a.txt";
};

TEST_F(NewFileTest, TakesItsNameWithAllOfItsBytes) {
  NewFile file(path_);
  file.Write("new ");
  file.Write("text");
  EXPECT_FALSE(fs::exists(path_));
  file.TakeName();
  EXPECT_EQ(TextOf(path_), "new text");
  EXPECT_EQ(Files(), 1);
}

TEST_F(NewFileTest, LeavesWhatWasThereWithoutIt) {
  std::ofstream(path_) << "old";
  { NewFile(path_).Write("new"); }
  EXPECT_EQ(TextOf(path_), "old");
  EXPECT_EQ(Refusal([&] {
              WriteWhole(path_, [](const fs::path& partial) {
                std::ofstream(partial) << "half";
                throw std::ios_base::failure("write");
              });
            }),
            ErrorKind::kUnavailable);
  EXPECT_EQ(TextOf(path_), "old");
  EXPECT_EQ(Files(), 1);
}

TEST_F(NewFileTest, AKilledWriterLeavesNothing) {
  const int nameless = open(folder_.path().c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (nameless < 0) GTEST_SKIP() << "the file system makes no files without a name";
  close(nameless);
  const pid_t writer = fork();
  if (writer == 0) {
    NewFile file(path_);
    file.Write("half");
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(writer, &status, 0), writer);
  EXPECT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(Files(), 0);
}

TEST_F(NewFileTest, RefusesToReplaceWhereItMayNot) {
  std::ofstream(path_) << "old";
  EXPECT_EQ(Refusal([&] { NewFile(path_, IfThere::kRefuse); }), ErrorKind::kConflict);
  fs::remove(path_);
  NewFile file(path_, IfThere::kRefuse);
  file.Write("new");
  std::ofstream(path_) << "meanwhile";
  EXPECT_EQ(Refusal([&] { file.TakeName(); }), ErrorKind::kConflict);
  EXPECT_EQ(TextOf(path_), "meanwhile");
}

// A link that leads nowhere is there, too.
TEST_F(NewFileTest, WhereRenamingReplacesNothingIsLostOrLeftBehind) {
  is_without_noreplace = true;
  const auto write = [&] {
    return Refusal([&] {
      NewFile file(path_, IfThere::kRefuse);
      file.Write("new");
      file.TakeName();
    });
  };
  is_without_rename = true;
  EXPECT_EQ(write(), ErrorKind::kUnavailable);
  EXPECT_EQ(Files(), 0);
  is_without_rename = false;
  EXPECT_EQ(write(), std::nullopt);
  EXPECT_EQ(write(), ErrorKind::kConflict);
  is_without_noreplace = false;
  EXPECT_EQ(TextOf(path_), "new");
  EXPECT_EQ(Files(), 1);
}

TEST_F(NewFileTest, FollowsNoLink) {
  std::ofstream(folder_.path() / "victim") << "precious";
  fs::create_symlink(folder_.path() / "none", path_);
  EXPECT_EQ(Refusal([&] { NewFile(path_, IfThere::kRefuse); }), ErrorKind::kInvalidArgument);
  fs::remove(path_);
  fs::create_symlink(folder_.path() / "victim", path_);
  EXPECT_EQ(Refusal([&] { NewFile{path_}; }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(TextOf(path_), "precious");
}

TEST_F(NewFileTest, ReplacesRegularFilesOnly) {
  ASSERT_EQ(mkfifo(path_.c_str(), 0600), 0);
  for (const fs::path& bad : {path_, fs::path("/dev/full"), folder_.path()}) {
    EXPECT_EQ(Refusal([&] { CheckNewFile(bad, IfThere::kReplace); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_TRUE(fs::is_fifo(path_));
  EXPECT_EQ(Refusal([&] { CheckNewFile("/no/such/folder/a", IfThere::kReplace); }),
            ErrorKind::kNotFound);
  fs::remove(path_);
  std::ofstream(path_) << "old";
  EXPECT_EQ(Refusal([&] { CheckNewFile(path_, IfThere::kReplace); }), std::nullopt);
  EXPECT_EQ(TextOf(path_), "old");
  EXPECT_EQ(Files(), 1);
}

// Pipes and links under the name that partial files had before.
TEST_F(NewFileTest, OpensNothingThatLayThere) {
  ASSERT_EQ(mkfifo((path_.string() + ".partial").c_str(), 0600), 0);
  NewFile file(path_);
  file.Write("new");
  file.TakeName();
  EXPECT_EQ(TextOf(path_), "new");
}

TEST_F(NewFileTest, SaysWhyItCannotWrite) {
  EXPECT_EQ(Refusal([&] { NewFile(folder_.path() / "none" / "a"); }), ErrorKind::kNotFound);
  EXPECT_EQ(Refusal([&] { NewFile("/proc/self/a"); }), ErrorKind::kNotFound);
  EXPECT_EQ(Refusal([&] { NewFile(folder_.path()); }), ErrorKind::kInvalidArgument);
}

// Files may grow to a limit here, as on a disk that fills up.
TEST_F(NewFileTest, AFullDiskHasAKindOfItsOwn) {
  signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &limit), 0);
  const rlimit unlimited = limit;
  limit.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const auto refused = Refusal([&] { NewFile(path_).Write(std::string(2000, 'a')); });
  const auto refused_stream = Refusal([&] {
    WriteWhole(path_, [](const fs::path& partial) {
      std::ofstream out(partial);
      out.exceptions(std::ios::failbit | std::ios::badbit);
      out << std::string(100'000, 'a') << std::flush;
    });
  });
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &unlimited), 0);
  EXPECT_EQ(refused, ErrorKind::kDiskFull);
  EXPECT_EQ(refused_stream, ErrorKind::kDiskFull);
  EXPECT_EQ(Files(), 0);
}

}  // namespace

namespace {

using testing::Refusal;

TEST(TextFile, IsReadWholeOrRefusedAtOnce) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return folder.path() / name; };
  const std::string text("a\0b\n", 4);
  std::ofstream(path("text"), std::ios::binary) << text;
  std::filesystem::create_symlink("text", path("link"));
  EXPECT_EQ(ReadTextFile(path("text"), 4), text);
  EXPECT_EQ(ReadTextFile(path("link"), 1 << 20), text);
  mkfifo(path("pipe").c_str(), 0600);  // nobody writes to it
  struct Row {
    std::filesystem::path path;
    ErrorKind kind;
  };
  for (const Row& row :
       {Row{path("absent"), ErrorKind::kNotFound}, Row{path("text") / "x", ErrorKind::kNotFound},
        Row{folder.path(), ErrorKind::kInvalidArgument},
        Row{path("pipe"), ErrorKind::kInvalidArgument},
        Row{"/dev/zero", ErrorKind::kInvalidArgument},
        Row{path("text"), ErrorKind::kInvalidArgument}}) {
    EXPECT_EQ(Refusal([&] { ReadTextFile(row.path, 3); }), row.kind) << row.path;
  }
}

TEST(NumberText, HasAllDigitsThatMatter) {
  EXPECT_EQ(NumberText(-48123.450825), "-48123.450825");
  EXPECT_EQ(NumberText(4080123456.450825), "4080123456.450825");
  EXPECT_EQ(NumberText(0.1 + 0.2), "0.3");
  EXPECT_EQ(NumberText(1234567.875), "1234567.875");
  EXPECT_EQ(NumberText(0.1f), "0.1");
  EXPECT_EQ(NumberText(-1024), "-1024");
  EXPECT_EQ(NumberText(0), "0");
  EXPECT_EQ(NumberText(std::nan("")), "nan");
  std::mt19937 random(1);
  std::uniform_real_distribution<float> any(-1e5f, 1e5f);
  for (int n = 0; n < 1000; ++n) {
    const float number = any(random);
    EXPECT_EQ(std::strtof(NumberText(number).c_str(), nullptr), number);
  }
}

// As where our standard input is closed: the log of a program may get the number 0.
TEST(ChildProcessTest, ADescriptorMayHaveANumberThatIsFilledBefore) {
  Pipe pipe = MakePipe();
  const Descriptor kept(fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3));
  ASSERT_EQ(dup2(pipe.write.get(), STDIN_FILENO), STDIN_FILENO);
  ChildProcess child({"/bin/echo", "here"}, std::array{-1, STDIN_FILENO, -1},
                     ChildProcess::Group::kOwnGroup);
  dup2(kept.get(), STDIN_FILENO);
  while (!child.Poll()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::array<char, 8> said{};
  EXPECT_EQ(read(pipe.read.get(), said.data(), said.size()), 5);
}

}  // namespace

}  // namespace palpate
