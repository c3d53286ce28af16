#include "tests/support/allocation_count.h"

#include <sys/types.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace {
std::atomic<std::uint64_t> allocations{0}, watched{0};
std::atomic<pid_t> watched_thread{0};
}  // namespace

// new[] and the nothrow forms come here, too. Not inlined, or gcc takes malloc and delete for a
// mismatched pair.
[[gnu::noinline]] void* operator new(std::size_t size) {
  ++allocations;
  if (const pid_t thread = watched_thread; thread != 0 && thread == gettid()) ++watched;
  if (void* memory = std::malloc(size > 0 ? size : 1)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace palpate::test {

std::uint64_t Allocations() { return allocations; }

void WatchThread(int thread) {
  watched_thread = thread;
  watched = 0;
}

std::uint64_t WatchedAllocations() { return watched; }

}  // namespace palpate::test
