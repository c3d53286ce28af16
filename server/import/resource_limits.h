// Limits this process's resources, so that a hostile file cannot harm the machine.
#pragma once

#include <cstdint>

namespace palpate {

// Limits the calling process permanently: private writable memory (the present use, its threads'
// stacks and `max_memory_bytes`; beyond it std::bad_alloc), processor time, size of written files
// (beyond it a write fails), open files, threads (not root's), and no core dump. Gives way. Throws
// Error (kInternal).
void LimitResources(std::int64_t max_memory_bytes, std::int64_t max_seconds);

// Gives way to other processes, such as the haptic loop. If memory runs out, the kernel ends this
// process before palpated.
void GiveWay();

}  // namespace palpate
