// confined_child HOW WHAT FOLDER: tries one thing in a process that is confined as palpate-import
// is. confinement_test.cpp runs it.
//   HOW   readable: Confine() with FOLDER/readable; everywhere: with nothing;
//         linked: with FOLDER/link, a link to FOLDER/readable; threaded: as readable, while a
//         thread runs; free: without Confine()
//   WHAT  a row of confined_attacks.cpp or confined_works.cpp
// confined_child list: the rows of confined_attacks.cpp.
//
// Exit codes: 0 it succeeded; its errno; 128 and the signal that ended it.
#include "tests/integration/confined_child.h"

#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>

#include "common/error/error.h"
#include "server/import/confinement.h"
#include "server/import/reporter.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr int kSignalled = 128;
constexpr int kNotSetUp = 127;

// Two processes: the confined one, and its parent, which is attacked.

void SetUp(const fs::path& folder) {
  parent = getpid();
  readable_file = folder / "readable/file";
  other_file = folder / "other/file";
  new_file = folder / "readable/new";
  parents_memory = "/proc/" + std::to_string(parent) + "/mem";
  memory_file = memfd_create("output", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  memory_file_path = "/proc/self/fd/" + std::to_string(memory_file);
  int ends[2] = {-1, -1};
  Check(memory_file >= 0 && pipe(ends) == 0, "make files");
  Check(ftruncate(memory_file, sizeof bytes) == 0, "make files");
  pipe_to_write = ends[1];
  // Yama allows a process to be traced by its children only if it says so.
  prctl(PR_SET_PTRACER, PR_SET_PTRACER_ANY);
}

// As palpate-import.
void ConfineAsTold(std::string_view how, std::string_view what, const fs::path& folder,
                   Reporter* reporter) {
  reporter->FailOnCrash("the reader of tests crashed", ErrorKind::kInternal);
  reporter->FailAfter(what == kTimeout ? 1 : 60);
  // The limit of threads is not for root.
  if (what == kManyThreads && geteuid() == 0) Check(setuid(65534) == 0, "setuid");
  LimitResources(std::int64_t{1} << 28, 100);
  if (how == "threaded")
    std::thread([] { std::this_thread::sleep_for(std::chrono::seconds(20)); }).detach();
  if (how == "readable" || how == "threaded") Confine({folder / "readable"});
  if (how == "everywhere") Confine({});
  if (how == "linked") Confine({folder / "link"});
}

int Try(std::string_view what) {
  for (const Attack& attack : Attacks()) {
    if (what != attack.name) continue;
    return attack.attempt() < 0 ? errno : 0;
  }
  for (const Work& work : Works()) {
    if (what != work.name) continue;
    work.done();
    return 0;
  }
  throw std::runtime_error("no such row");
}

int RunConfined(std::string_view how, std::string_view what, const fs::path& folder) {
  Reporter reporter(std::string(what), false);
  try {
    ConfineAsTold(how, what, folder, &reporter);
    return Try(what);
  } catch (const std::exception& error) {
    reporter.Fail(error.what());
    return kNotSetUp;
  }
}

void List() {
  constexpr const char* kGuards[] = {"files", "calls", "both", "kills"};
  for (const Attack& attack : Attacks()) {
    std::printf("%s %s %s\n", attack.name, kGuards[static_cast<int>(attack.guard)],
                attack.free == Free::kSucceeds ? "succeeds" : "unknown");
  }
}

int Run(std::string_view how, std::string_view what, const fs::path& folder) {
  SetUp(folder);
  const pid_t child = fork();
  if (child < 0) return kNotSetUp;
  // _exit(): the sanitizers' search for leaks is no part of this.
  if (child == 0) _exit(RunConfined(how, what, folder));
  int status = 0;
  if (waitpid(child, &status, 0) != child) return kNotSetUp;
  return WIFEXITED(status) ? WEXITSTATUS(status) : kSignalled + WTERMSIG(status);
}

}  // namespace
}  // namespace palpate

int main(int count, char** arguments) {
  if (count == 2 && std::string_view(arguments[1]) == "list") {
    palpate::List();
    return 0;
  }
  if (count != 4) return palpate::kUsageExitCode;
  return palpate::Run(arguments[1], arguments[2], arguments[3]);
}
