// Bounds on what this process may use, so that a hostile file cannot harm the
// machine.
#pragma once

#include <cstdint>

namespace palpate {

// Of the process that calls it, for good: address space (what it has now plus
// `max_memory_bytes`; std::bad_alloc beyond), processor time, size of written
// files (a failing write beyond), open files, no core dump. Yields to other
// processes, such as the haptic loop. Throws Error(kInternal).
void LimitResources(std::int64_t max_memory_bytes, std::int64_t max_seconds);

}  // namespace palpate
