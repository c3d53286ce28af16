// A program that this one runs beside itself, and pipes to it.
//
// Threads: one. Uses posix_spawn, because fork would make a real-time thread's pages copy-on-write.
// Errors: std::system_error.
#pragma once

#include <sys/types.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/files/descriptor.h"

namespace palpate {

struct Pipe {
  Descriptor read;
  Descriptor write;
};

// Only our end, `read`, is non-blocking: the program may block, we must not.
Pipe MakePipe();

class ChildProcess {
 public:
  // Neither gets our terminal's Ctrl-C. Linux shares the processors between sessions (autogroup in
  // sched(7)), so that niceness counts only within one.
  enum class Group { kOwnGroup, kOwnSession };

  // `arguments`: the program's path first. `descriptors[n]`: what it gets as its descriptor n;
  // below 0: /dev/null. It gets no other descriptor and no blocked signal.
  ChildProcess(std::vector<std::string> arguments, std::span<const int> descriptors, Group group);
  // Kills it and what it has started, unless it has ended or was left.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  // Returns waitpid's status once it has ended. Never waits.
  std::optional<int> Poll();
  // To it and what it has started; none once it has ended.
  void Signal(int number);
  // It goes on after this object.
  void Leave() { left_ = true; }

 private:
  pid_t pid_ = -1;
  std::optional<int> status_;
  bool left_ = false;
};

}  // namespace palpate
