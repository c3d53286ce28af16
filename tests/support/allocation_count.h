// Counts every allocation of a program that links allocation_count.cpp, which replaces the global
// operator new. Threads: any.
#pragma once

#include <cstdint>

namespace palpate::test {

std::uint64_t Allocations();

// Counts the allocations of one thread from now on. `thread`: its number in /proc/self/task; 0:
// none.
void WatchThread(int thread);
std::uint64_t WatchedAllocations();

}  // namespace palpate::test
