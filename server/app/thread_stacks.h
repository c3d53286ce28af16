// Stacks of threads, where all memory is locked.
#pragma once

#include <tbb/global_control.h>

#include <cstddef>

namespace palpate {

// The largest frame of ours is of 19 KiB; a servo's tick has the 256 KiB that
// SetupRealtimeThread touches.
inline constexpr std::size_t kThreadStackBytes = 1 << 20;

// Threads that are made from now on, those of a device's library too, get a stack of
// kThreadStackBytes instead of the usual 8 MiB (TBB's workers, as long as this is there: 4 MiB).
// Locked memory is resident whether it is used or not: gRPC makes threads as it needs them, each
// took 8 MiB of RAM for some 20 KiB in use, and together they were most of what the daemon held.
//
// One for the process, before its first thread (the four that OpenVDB's log4cplus makes when it
// is loaded come before, and stay as they are); not real-time. At worst stacks stay as large as
// they are.
class SmallThreadStacks {
 public:
  SmallThreadStacks();

 private:
  // TBB also nests tasks on a thread of ours no deeper than half of it.
  tbb::global_control workers_;
};

}  // namespace palpate
