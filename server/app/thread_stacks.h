// Sets the stack size of threads. With locked memory, every stack is resident. Apart for its tests.
#pragma once

#include <tbb/global_control.h>

#include <cstddef>

namespace palpate {

// The largest stack frame of our code has 19 KiB. For the servo's tick, SetupRealtimeThread touches
// 256 KiB.
inline constexpr std::size_t kThreadStackBytes = 1 << 20;

// While this object lives, new threads get a stack of kThreadStackBytes instead of the usual 8 MiB.
// This includes threads of a device's library. TBB's workers get 4 MiB.
// Locked memory is resident whether it is used or not. gRPC makes threads as it needs them. Each
// thread took 8 MiB of RAM and used some 20 KiB; together their stacks were most of the daemon's
// memory.
//
// Make one for the process, before its first thread. (OpenVDB's log4cplus makes four threads when
// it is loaded. These four come earlier and keep their stacks.) Not real-time. If the size cannot
// be set, stacks keep their usual size.
class SmallThreadStacks {
 public:
  SmallThreadStacks();

 private:
  // TBB nests tasks on our threads, too, but no deeper than half of this stack size.
  tbb::global_control workers_;
};

}  // namespace palpate
