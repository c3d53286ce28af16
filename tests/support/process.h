// Runs a program and collects its output. Threads: one. The test fails, also from the destructor,
// if the program
// - crashes: a signal ends it that the test did not send
// - prints a sanitizer report
// - does not end in time; it is killed then
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <functional>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

extern char** environ;

namespace palpate::test {

struct ProcessResult {
  int exit_code = -1;  // minus the signal, if a signal ended it
  std::string output;
  std::string error;
};

class Process {
 public:
  static constexpr std::chrono::milliseconds kEndPatience{120000};

  // `patience`: the longest time that it may run. `end_patience`: the longest time from a signal to
  // its end.
  explicit Process(const std::vector<std::string>& arguments,
                   std::chrono::seconds patience = std::chrono::seconds(120),
                   std::chrono::milliseconds end_patience = kEndPatience)
      : end_patience_(end_patience), deadline_(std::chrono::steady_clock::now() + patience) {
    int child_output = -1, child_error = -1;
    OpenPipe(output_, child_output);
    OpenPipe(error_, child_error);
    // The child copies these over its own descriptors. gRPC's threads do not allow fork() here.
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, child_output, STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, child_error, STDERR_FILENO);
    std::vector<char*> argv;
    for (const std::string& argument : arguments) {
      argv.push_back(const_cast<char*>(argument.c_str()));
    }
    argv.push_back(nullptr);
    const int failure = posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(child_output);
    close(child_error);
    if (failure != 0) throw std::runtime_error("cannot start " + arguments[0]);
  }

  ~Process() {
    if (WasToldToEnd()) Wait();
    if (pid_ > 0) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) != pid_) {
        Signal(SIGKILL);
        waitpid(pid_, &status, 0);
      }
      TakeLastWords();
      FailOnACrash(status);
    }
    close(output_);
    close(error_);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // Does nothing after Wait(): with pid -1, kill() would signal every process.
  void Signal(int number) {
    if (pid_ <= 0) return;
    sent_.insert(number);
    if (number != SIGSTOP && number != SIGCONT) {
      deadline_ = std::chrono::steady_clock::now() + end_patience_;
    }
    kill(pid_, number);
  }
  pid_t pid() const { return pid_; }

  // Ends the program as an operator does, unless the test has awaited or killed it. The test fails
  // if the exit code is not 0.
  void EndInOrder() {
    if (pid_ <= 0 || sent_.contains(SIGKILL)) return;
    Signal(SIGTERM);
    Signal(SIGCONT);  // a test may have stopped it
    const ProcessResult end = Wait();
    if (end.exit_code != 0) {
      ADD_FAILURE() << "a program ended with " << end.exit_code << ", not with 0\n" << end.error;
    }
  }

  // Collects until stdout or stderr contains `text`. Returns false if it never does.
  bool WaitFor(const std::string& text) {
    return WaitUntil([&](const ProcessResult& so_far) {
      return so_far.output.find(text) != std::string::npos ||
             so_far.error.find(text) != std::string::npos;
    });
  }
  // Collects until it is so. Returns false if it never is.
  bool WaitUntil(const std::function<bool(const ProcessResult&)>& is_so) {
    while (!is_so(result_)) {
      if (!Collect()) return false;
    }
    return true;
  }

  // Collects to the end.
  ProcessResult Wait() {
    if (pid_ <= 0) return result_;
    while (Collect()) {
    }
    int status = 0;
    if (!EndsInTime(status)) {
      ADD_FAILURE() << (WasToldToEnd() ? "a program was told to end, and does not\n"
                                       : "a program runs for longer than its patience\n")
                    << result_.error;
      Signal(SIGKILL);
      waitpid(pid_, &status, 0);
    }
    pid_ = -1;
    FailOnACrash(status);
    result_.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    return result_;
  }

 private:
  static void OpenPipe(int& read_end, int& write_end) {
    int ends[2] = {-1, -1};
    if (pipe2(ends, O_CLOEXEC) != 0) throw std::runtime_error("cannot open a pipe");
    read_end = ends[0];
    write_end = ends[1];
  }

  bool WasToldToEnd() const {
    return sent_.contains(SIGTERM) || sent_.contains(SIGINT) || sent_.contains(SIGQUIT);
  }

  bool EndsInTime(int& status) const {
    while (waitpid(pid_, &status, WNOHANG) != pid_) {
      if (std::chrono::steady_clock::now() >= deadline_) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return true;
  }

  // Reads the rest after the program's end. A child of the program may still keep the pipe open.
  void TakeLastWords() {
    fcntl(error_, F_SETFL, O_NONBLOCK);
    while (!error_ended_) Take({error_, POLLIN, POLLIN}, result_.error, error_ended_);
  }

  void FailOnACrash(int status) const {
    const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    const bool crashed = signal != 0 && !sent_.contains(signal);
    if (crashed) {
      ADD_FAILURE() << "a program crashed (signal " << signal << ")\n" << result_.error;
    } else if (result_.error.find("Sanitizer") != std::string::npos ||
               result_.error.find("runtime error:") != std::string::npos) {
      ADD_FAILURE() << "a sanitizer found something\n" << result_.error;
    }
  }

  // Returns false when both outputs have ended, or the time is up.
  bool Collect() {
    if (std::chrono::steady_clock::now() >= deadline_) return false;
    pollfd files[2] = {{output_ended_ ? -1 : output_, POLLIN, 0},
                       {error_ended_ ? -1 : error_, POLLIN, 0}};
    poll(files, 2, 100);
    Take(files[0], result_.output, output_ended_);
    Take(files[1], result_.error, error_ended_);
    return !error_ended_ || !output_ended_;
  }

  static void Take(const pollfd& file, std::string& text, bool& ended) {
    if (file.fd < 0 || file.revents == 0) return;
    char buffer[65536];
    const ssize_t count = read(file.fd, buffer, sizeof(buffer));
    if (count > 0) {
      text.append(buffer, static_cast<std::size_t>(count));
    } else {
      ended = true;
    }
  }

  pid_t pid_ = -1;
  int output_ = -1;
  int error_ = -1;
  bool output_ended_ = false;
  bool error_ended_ = false;
  ProcessResult result_;
  const std::chrono::milliseconds end_patience_;
  std::chrono::steady_clock::time_point deadline_;
  std::set<int> sent_;
};

}  // namespace palpate::test
