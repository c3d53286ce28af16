// A program that runs beside the viewer: the desktop's file dialog, or a palpated.
//
// Threads: one. Errors: Error with kUnavailable if it cannot be started.
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/files/child_process.h"

namespace palpate::view {

// The value of an environment variable; empty: it is not set.
std::string VariableOf(const char* name);

// Returns the program's path: the first of that name that may be run in `path_variable`, folders
// divided by colons. Empty: there is none.
std::filesystem::path FindProgram(const std::string& name, const std::string& path_variable);

class ChildProgram {
 public:
  // `arguments`: the first is the program's path. Without `log`, output() gets what it prints on
  // stdout; with it, both outputs are written to that new file. It has a session of its own, so
  // that Ctrl-C in the viewer's terminal does not reach it.
  explicit ChildProgram(std::vector<std::string> arguments, const std::filesystem::path& log = {});
  // Ends it as End does, with a patience of one second, unless it was left.
  ~ChildProgram();
  ChildProgram(const ChildProgram&) = delete;
  ChildProgram& operator=(const ChildProgram&) = delete;

  // Returns the exit code if it has ended; minus the signal, if a signal ended it. Never waits.
  std::optional<int> Poll();
  // What it printed until the last Poll; at most 64 KiB of it.
  const std::string& output() const { return output_; }
  // SIGTERM to it and its children; after `patience` SIGKILL.
  void End(std::chrono::milliseconds patience);
  // It goes on after this object.
  void Leave() {
    left_ = true;
    process_->Leave();
  }

 private:
  std::optional<ChildProcess> process_;
  Descriptor out_;  // reads what it prints; with a log none, and a read fails
  std::string output_;
  std::optional<int> exit_code_;
  bool left_ = false;
};

}  // namespace palpate::view
