#include "server/realtime/process_heap.h"

#include <jemalloc/jemalloc.h>
#include <sys/mman.h>

#include <cstddef>

#ifndef MADV_DONTNEED_LOCKED
#define MADV_DONTNEED_LOCKED 24
#endif
#pragma weak mallctl

// Read by jemalloc before main.
// - One arena: memory freed by one thread is used by all others.
// - oversize_threshold: large blocks too come from this arena, which has our hooks.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf =
    "narenas:1,oversize_threshold:0,background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0";
}

namespace palpate {
namespace {

// True: the pages were not given back.
bool GivePagesBack(extent_hooks_t*, void* address, std::size_t, std::size_t offset,
                   std::size_t length, unsigned) {
  void* const pages = static_cast<char*>(address) + offset;
  return madvise(pages, length, MADV_DONTNEED_LOCKED) != 0 &&
         madvise(pages, length, MADV_DONTNEED) != 0;
}

}  // namespace

void SetUpProcessHeap() noexcept {
  if (!mallctl) return;
  static extent_hooks_t hooks;
  extent_hooks_t* defaults = nullptr;
  std::size_t size = sizeof defaults;
  if (mallctl("arena.0.extent_hooks", &defaults, &size, nullptr, 0) != 0) return;
  hooks = *defaults;
  hooks.purge_forced = GivePagesBack;
  extent_hooks_t* ours = &hooks;
  mallctl("arena.0.extent_hooks", nullptr, nullptr, &ours, sizeof ours);
}

void ReturnFreedMemory() noexcept {
  if (mallctl) mallctl("arena.0.purge", nullptr, nullptr, nullptr, 0);
}

}  // namespace palpate
