// Asks the kernel for what a real-time thread needs, and says what it refused.
//
// Nothing here throws or gives up: every refusal adds one line to the warnings,
// with what to do about it, and the thread goes on with less.
#pragma once

#include <string>
#include <vector>

namespace palpate {

struct RealtimeOptions {
  int priority = 80;        // of SCHED_FIFO, 1 to 99
  int cpu = -1;             // the core to stay on; -1: any
  bool lock_memory = true;  // see LockProcessMemory
};

// What the kernel granted.
struct RealtimeGrant {
  bool fifo = false;
  bool memory_locked = false;
  std::vector<std::string> warnings;  // one line each
};

// Keeps all memory of the process, present and future, in RAM. Does so only where
// locked memory is unlimited (RLIMIT_MEMLOCK or CAP_IPC_LOCK): under a finite limit
// it may succeed now and make any later allocation fail. Any thread, not
// real-time. False: not locked, and a warning says why.
//
// What is mapped later is locked when it is first written, not when it is mapped: what the heap
// only reserves takes no memory. The servo reads nothing that others did not write before.
bool LockProcessMemory(std::vector<std::string>& warnings) noexcept;

// Gives what was freed back to the system: the heap would keep it, as bricks are small.
//
// Takes milliseconds, with locked memory about 200 for each GiB that the process has; other
// threads that allocate wait meanwhile. Locked pages cannot be given back, so that the heap, which
// holds the bricks, is unlocked for that time. Any ordinary thread; a real-time thread that does
// not allocate is not held up.
void ReturnFreedMemory() noexcept;

// Makes the calling thread a real-time one, before its loop: SCHED_FIFO (children
// start as ordinary processes), core, memory, the stack that a tick may need, and
// the thread's name. Not real-time itself.
void SetupRealtimeThread(const RealtimeOptions& options, RealtimeGrant& grant) noexcept;

// Page faults of the calling thread so far, minor and major. One system call
// that does not block: a real-time thread may call it now and then.
long ThreadPageFaults() noexcept;

}  // namespace palpate
