// Stacks of threads, where all memory is locked.
#pragma once

#include <tbb/global_control.h>

#include <cstddef>

namespace palpate {

// OpenSSL's handshakes and OpenVDB's trees use some tens of KiB of it, a servo's tick what
// SetupRealtimeThread touches.
inline constexpr std::size_t kThreadStackBytes = 1 << 20;

// Threads that are made from now on get a stack of kThreadStackBytes instead of the usual
// 8 MiB (TBB's workers, as long as this is there: 4 MiB). Locked memory is resident whether it
// is used or not: gRPC makes threads as it needs them, each took 8 MiB of RAM for some 20 KiB
// in use, and together they were most of what the daemon held.
//
// One for the process, before its first thread; not real-time. Never fails: at worst stacks
// stay as large as they are.
class SmallThreadStacks {
 public:
  SmallThreadStacks() noexcept;

 private:
  // So that TBB knows how deep it may nest tasks on a thread of ours: half of it.
  tbb::global_control workers_;
};

}  // namespace palpate
