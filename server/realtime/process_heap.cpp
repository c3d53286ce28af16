#include "server/realtime/process_heap.h"

#include <jemalloc/jemalloc.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstddef>

#ifndef MADV_DONTNEED_LOCKED
#define MADV_DONTNEED_LOCKED 24
#endif
#pragma weak mallctl

extern "C" {

// Read by jemalloc before main. With one arena, for large blocks too, memory freed by one thread is
// used by all others.
extern const char* malloc_conf;
const char* malloc_conf =
    "narenas:1,oversize_threshold:0,background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0";

// In place of the C library's, for jemalloc: the kernel refuses MADV_DONTNEED for locked pages.
// (jemalloc's own hooks cannot be used: they must not be set for arena 0, the only one here.)
int madvise(void* address, std::size_t length, int advice) noexcept {
  if (advice == MADV_DONTNEED && syscall(SYS_madvise, address, length, MADV_DONTNEED_LOCKED) == 0) {
    return 0;
  }
  return static_cast<int>(syscall(SYS_madvise, address, length, advice));
}
}

namespace palpate {

void ReturnFreedMemory() noexcept {
  if (mallctl) mallctl("arena.0.purge", nullptr, nullptr, nullptr, 0);
}

}  // namespace palpate
