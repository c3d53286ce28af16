// Confine(): what palpate-import can still do, and what it cannot. Each case runs in a process of
// its own, confined_child.cpp.
#include "server/import/confinement.h"

#include <linux/landlock.h>
#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {
namespace {

namespace fs = std::filesystem;

constexpr int kSucceeded = 0;
constexpr int kKilled = 128 + SIGSYS;

#ifdef PALPATE_SANITIZED
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

bool KernelHasLandlock() {
  return syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION) > 0;
}

// In a folder of its own: what is not refused changes its files.
ProcessResult RunChild(const std::string& how, const std::string& what) {
  const TemporaryFolder folder;
  for (const char* name : {"readable", "other"}) {
    fs::create_directory(folder.path() / name);
    std::ofstream(folder.path() / name / "file") << name;
  }
  fs::create_directory(folder.path() / "other/file.folder");
  fs::create_symlink(folder.path() / "other/file", folder.path() / "readable/file.link");
  fs::create_directory_symlink(folder.path() / "readable", folder.path() / "link");
  return Process({kConfinedChild, how, what, folder.path()}).Wait();
}

struct Attack {
  std::string name, guard, free;
};

std::vector<Attack> Attacks() {
  std::istringstream list(Process({kConfinedChild, "list"}).Wait().output);
  std::vector<Attack> attacks;
  for (Attack a; list >> a.name >> a.guard >> a.free;) attacks.push_back(a);
  return attacks;
}

// By the filter of system calls, which sanitizer builds do not have.
bool FilterRefuses(const Attack& attack) { return !kSanitized && attack.guard != "files"; }

bool IsRefused(const Attack& attack) {
  const bool by_landlock = attack.guard == "files" || attack.guard == "both";
  return FilterRefuses(attack) || (by_landlock && KernelHasLandlock());
}

void ExpectRefused(const Attack& attack, const std::string& how) {
  SCOPED_TRACE(attack.name + ", " + how);
  const ProcessResult result = RunChild(how, attack.name);
  if (FilterRefuses(attack) && attack.guard == "kills") {
    EXPECT_EQ(result.exit_code, kKilled) << result.error;
  } else {
    EXPECT_TRUE((std::set{EPERM, EACCES, ENOSYS}.contains(result.exit_code)))
        << result.exit_code << result.error;
  }
}

TEST(Confinement, RefusesAttacks) {
  const std::vector<Attack> attacks = Attacks();
  EXPECT_GE(attacks.size(), 100u);
  for (const Attack& attack : attacks) {
    if (IsRefused(attack)) ExpectRefused(attack, "readable");
  }
}

// Else the test before would pass for another reason: missing privileges, a wrong path.
TEST(Confinement, AttacksSucceedWithoutIt) {
  for (const Attack& attack : Attacks()) {
    if (attack.free != "succeeds") continue;
    EXPECT_EQ(RunChild("free", attack.name).exit_code, kSucceeded) << attack.name;
  }
}

TEST(Confinement, WithoutPathsEveryFileCanBeReadAndNoneWritten) {
  for (const Attack& attack : Attacks()) {
    const bool reads = attack.name == "read_other_file" || attack.name == "read_etc_passwd" ||
                       attack.name == "read_through_link" || attack.name == "list_root";
    if (reads) {
      EXPECT_EQ(RunChild("everywhere", attack.name).exit_code, kSucceeded) << attack.name;
    } else if (IsRefused(attack)) {
      ExpectRefused(attack, "everywhere");
    }
  }
}

TEST(Confinement, PathsWithLinksAreLeftOut) {
  if (!KernelHasLandlock()) GTEST_SKIP() << "the kernel has no Landlock";
  const ProcessResult result = RunChild("linked", "read_files");
  EXPECT_NE(result.exit_code, kSucceeded);
  EXPECT_NE(result.error.find("read: Permission denied"), std::string::npos) << result.error;
}

// Such a thread could read every file.
TEST(Confinement, FailsWhileAThreadRuns) {
  if (kSanitized) GTEST_SKIP() << "the sanitizers have threads of their own";
  const ProcessResult result = RunChild("threaded", "read_files");
  EXPECT_NE(result.exit_code, kSucceeded);
  EXPECT_NE(result.error.find("other threads run already"), std::string::npos) << result.error;
}

// What else readers do is shown by import_test, with the readers.
TEST(Confinement, ReadersCanWork) {
  for (const std::string how : {"free", "readable", "everywhere"}) {
    for (const std::string work : {"read_files", "write_memory_file"}) {
      const ProcessResult result = RunChild(how, work);
      EXPECT_EQ(result.exit_code, kSucceeded) << work << ", " << how << ": " << result.error;
    }
  }
}

TEST(Confinement, AThreadBombEnds) {
  if (kSanitized) GTEST_SKIP() << "the sanitizers keep much memory for each thread";
  const ProcessResult result = RunChild("readable", "many_threads");
  EXPECT_EQ(result.exit_code, kSucceeded) << result.error;
}

TEST(Confinement, CrashesAndTimeoutsAreReported) {
  const auto expect = [](const std::string& work, ErrorKind kind, const std::string& text) {
    const ProcessResult result = RunChild("readable", work);
    EXPECT_EQ(result.exit_code, ExitCode(kind)) << work;
    EXPECT_NE(result.error.find(text), std::string::npos) << work << result.error;
  };
  expect("run_out_of_time", ErrorKind::kTooLarge, "took longer than 1 s");
  // The sanitizers have handlers of their own.
  if (kSanitized) return;
  expect("crash", ErrorKind::kInternal, "the reader of tests crashed");
  expect("crash_in_a_thread", ErrorKind::kInternal, "the reader of tests crashed");
}

}  // namespace
}  // namespace palpate::test
