// Counts every allocation of a program that links allocation_count.cpp, which replaces the global
// operator new. Threads: any.
#pragma once

#include <cstdint>

namespace palpate::test {

std::uint64_t Allocations();

// Of one thread, by its number in /proc/self/task, since it is watched; 0: of none.
void WatchThread(int thread);
std::uint64_t WatchedAllocations();

}  // namespace palpate::test
