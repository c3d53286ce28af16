// Counts every allocation of a program that links allocation_count.cpp, which replaces the global
// operator new. Threads: any.
#pragma once

#include <cstdint>

namespace palpate::test {

std::uint64_t Allocations();

}  // namespace palpate::test
