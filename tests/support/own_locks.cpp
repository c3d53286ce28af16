#include "tests/support/own_locks.h"

#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>

namespace {

using LockCall = int (*)(pthread_mutex_t*);

std::atomic<bool> held{false};
std::atomic<int> waiting_threads{0};

// Whether the code at this address belongs to the program, or to the log's library.
bool IsOwn(const void* caller) {
  static const char program_part = 0;
  Dl_info own{}, info{};
  if (dladdr(&program_part, &own) == 0 || dladdr(caller, &info) == 0) return false;
  return info.dli_fbase == own.dli_fbase || std::strstr(info.dli_fname, "spdlog") != nullptr;
}

LockCall Real(const char* name) { return reinterpret_cast<LockCall>(dlsym(RTLD_NEXT, name)); }

}  // namespace

extern "C" int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  static const LockCall real = Real("pthread_mutex_lock");
  if (held && IsOwn(__builtin_return_address(0))) {
    ++waiting_threads;
    while (held) usleep(1000);
    --waiting_threads;
  }
  return real(mutex);
}

extern "C" int pthread_mutex_trylock(pthread_mutex_t* mutex) noexcept {
  static const LockCall real = Real("pthread_mutex_trylock");
  return held && IsOwn(__builtin_return_address(0)) ? EBUSY : real(mutex);
}

namespace palpate::test {

AllOwnLocksHeld::AllOwnLocksHeld() { held = true; }
AllOwnLocksHeld::~AllOwnLocksHeld() { held = false; }
int AllOwnLocksHeld::waiting() { return waiting_threads; }

}  // namespace palpate::test
