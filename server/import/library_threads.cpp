#include "server/import/library_threads.h"

#include <dlfcn.h>

#include <chrono>
#include <filesystem>
#include <iterator>
#include <system_error>
#include <thread>

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::ptrdiff_t CountThreads() {
  std::error_code error;
  const fs::directory_iterator threads("/proc/self/task", error);
  return error ? 1 : std::distance(begin(threads), end(threads));
}

}  // namespace

void EndLibraryThreads() {
  // Looks the function up by name: log4cplus comes with OpenVDB only if OpenVDB was built with it,
  // and we do not link it.
  using Function = void (*)();
  const auto end =
      reinterpret_cast<Function>(dlsym(RTLD_DEFAULT, "_ZN9log4cplus18shutdownThreadPoolEv"));
  if (end) end();
}

bool IsOnlyThread() {
  constexpr int kTries = 1000;
  for (int k = 0; k < kTries; ++k) {
    if (CountThreads() == 1) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

}  // namespace palpate
