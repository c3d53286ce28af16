// Asks the kernel for what a real-time thread needs, and reports what the kernel refuses.
//
// No function here throws. Each refusal adds one line to the warnings with what to do about it, and
// the thread runs on without the refused right.
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

// Keeps all memory of the process in RAM, also memory that is mapped later. Works only if locked
// memory is unlimited (RLIMIT_MEMLOCK or CAP_IPC_LOCK): under a finite limit the call may succeed
// now and make a later allocation fail. Any thread, not real-time. Returns false if the memory is
// not locked; a warning says why.
//
// Memory that is mapped later is locked when it is first written, not when it is mapped. Memory
// that the heap only reserves therefore takes no RAM. The servo reads only memory that another
// thread has written before.
bool LockProcessMemory(std::vector<std::string>& warnings) noexcept;

// Makes the calling thread a real-time one; call it before the thread's loop. Sets SCHED_FIFO
// (child processes start with ordinary scheduling), the core, locked memory, the stack that a tick
// may need, and the thread's name. Not real-time itself.
void SetupRealtimeThread(const RealtimeOptions& options, RealtimeGrant& grant) noexcept;

// While it lives, the calling thread has ordinary scheduling: for work that may take long, such as
// calls into a vendor's library, for which LimitRTTIME= would end the process. Not real-time.
class OrdinaryScheduling {
 public:
  OrdinaryScheduling() noexcept;
  ~OrdinaryScheduling();
  OrdinaryScheduling(const OrdinaryScheduling&) = delete;
  OrdinaryScheduling& operator=(const OrdinaryScheduling&) = delete;

 private:
  const int policy_;
  int priority_ = 0;
};

// Sets the priority of the calling thread among ordinary ones; threads that it starts inherit it.
// Below 0 needs LimitNICE= (ulimit -e) or CAP_SYS_NICE: without, the thread keeps its priority.
void SetThreadNice(int nice) noexcept;
int ThreadNice() noexcept;

// Page faults of the calling thread so far, minor and major. One system call
// that does not block: a real-time thread may call it now and then.
long ThreadPageFaults() noexcept;

}  // namespace palpate
