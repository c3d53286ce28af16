// Runs a program and collects what it writes. Threads: one. A program that runs
// longer than its patience is killed. One that crashed, or does not end though it was told to,
// is named on our stderr, so that nobody takes a test that fails of it for one on a slow
// machine: tests/run.sh does not run it again.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

extern char** environ;

namespace palpate::test {

struct ProcessResult {
  int exit_code = -1;  // minus the signal, when one ended it
  std::string output;
  std::string error;
};

class Process {
 public:
  static constexpr std::chrono::seconds kEndPatience{120};

  // `on_terminal`: stdout is a terminal of 80 x 24.
  explicit Process(const std::vector<std::string>& arguments, bool on_terminal = false,
                   std::chrono::seconds patience = std::chrono::seconds(20))
      : deadline_(std::chrono::steady_clock::now() + patience) {
    int child_output = -1;
    if (on_terminal) {
      output_ = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
      grantpt(output_);
      unlockpt(output_);
      child_output = open(ptsname(output_), O_RDWR | O_NOCTTY | O_CLOEXEC);
      if (child_output < 0) throw std::runtime_error("cannot open a terminal: is /dev/pts there?");
      const winsize size{24, 80, 0, 0};
      ioctl(child_output, TIOCSWINSZ, &size);
    } else {
      OpenPipe(output_, child_output);
    }
    int child_error = -1;
    OpenPipe(error_, child_error);
    // The child copies these over its own; gRPC's threads allow no fork() here.
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
    if (failure != 0) {
      throw std::runtime_error("cannot start " + arguments[0]);
    }
  }

  ~Process() {
    if (pid_ > 0) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) != pid_) {
        Signal(SIGKILL);
        waitpid(pid_, &status, 0);
      }
      TakeLastWords();
      ShowCrash(status);
    }
    CloseOutput();
    close(error_);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // SIGTERM and SIGINT: it has kEndPatience from now on.
  void Signal(int number) {
    sent_.insert(number);
    if (number == SIGTERM || number == SIGINT) {
      deadline_ = std::chrono::steady_clock::now() + kEndPatience;
    }
    kill(pid_, number);
  }
  pid_t pid() const { return pid_; }

  // As a reader like `head` does.
  void CloseOutput() {
    if (output_ >= 0) {
      close(output_);
      output_ = -1;
    }
  }

  // Collects until stdout or stderr holds `text`; false when it never does.
  bool WaitFor(const std::string& text) {
    while (result_.output.find(text) == std::string::npos &&
           result_.error.find(text) == std::string::npos) {
      if (!Collect()) {
        return false;
      }
    }
    return true;
  }

  // Collects to the end.
  ProcessResult Wait() {
    while (Collect()) {
    }
    if (std::chrono::steady_clock::now() >= deadline_) {
      if (sent_.contains(SIGTERM) || sent_.contains(SIGINT)) {
        std::fprintf(stderr, "***Timeout: a program was told to end, and does not\n%s\n",
                     result_.error.c_str());
      }
      Signal(SIGKILL);
    }
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    ShowCrash(status);
    result_.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    return result_;
  }

 private:
  static void OpenPipe(int& read_end, int& write_end) {
    int ends[2] = {-1, -1};
    if (pipe2(ends, O_CLOEXEC) != 0) {
      throw std::runtime_error("cannot open a pipe");
    }
    read_end = ends[0];
    write_end = ends[1];
  }

  // Of a program that is gone; a child of its own may still hold the pipe.
  void TakeLastWords() {
    fcntl(error_, F_SETFL, O_NONBLOCK);
    while (!error_ended_) Take({error_, POLLIN, POLLIN}, result_.error, error_ended_);
  }

  void ShowCrash(int status) const {
    const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    const bool crashed = signal != 0 && !sent_.contains(signal);
    if (!crashed && result_.error.find("Sanitizer") == std::string::npos &&
        result_.error.find("runtime error:") == std::string::npos) {
      return;
    }
    std::fprintf(stderr, "***Exception: a program crashed (signal %d)\n%s\n", signal,
                 result_.error.c_str());
  }

  // False when both have ended, or time is up.
  bool Collect() {
    if (std::chrono::steady_clock::now() >= deadline_) {
      return false;
    }
    pollfd files[2] = {{output_ended_ ? -1 : output_, POLLIN, 0},
                       {error_ended_ ? -1 : error_, POLLIN, 0}};
    poll(files, 2, 100);
    Take(files[0], result_.output, output_ended_);
    Take(files[1], result_.error, error_ended_);
    return !error_ended_ || (output_ >= 0 && !output_ended_);
  }

  static void Take(const pollfd& file, std::string& text, bool& ended) {
    if (file.fd < 0 || file.revents == 0) {
      return;
    }
    char buffer[65536];
    const ssize_t count = read(file.fd, buffer, sizeof(buffer));
    if (count > 0) {
      text.append(buffer, static_cast<std::size_t>(count));
    } else {
      ended = true;  // a terminal ends with EIO
    }
  }

  pid_t pid_ = -1;
  int output_ = -1;
  int error_ = -1;
  bool output_ended_ = false;
  bool error_ended_ = false;
  ProcessResult result_;
  std::chrono::steady_clock::time_point deadline_;
  std::set<int> sent_;
};

}  // namespace palpate::test
