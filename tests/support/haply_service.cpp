#include "tests/support/haply_service.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <thread>

#include "tests/support/patience.h"
#include "tests/support/places.h"

extern char** environ;

namespace palpate::test {
namespace {

using nlohmann::json;

constexpr std::chrono::seconds kAnswerPatience{60};
constexpr std::chrono::seconds kEndPatience{10};

}  // namespace

HaplyService::HaplyService() {
  // Commands go through a socket: send() can do without SIGPIPE where write() cannot.
  int input[2] = {-1, -1}, output[2] = {-1, -1};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, input) != 0 ||
      pipe2(output, O_CLOEXEC) != 0) {
    throw std::runtime_error("cannot open a pipe");
  }
  commands_ = input[0];
  answers_ = output[0];
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, input[1], STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, output[1], STDOUT_FILENO);
  std::string program = "/usr/bin/python3", no_cache = "-B", script = kHaplyServiceScript;
  char* const argv[] = {program.data(), no_cache.data(), script.data(), nullptr};
  const int failure = posix_spawn(&pid_, argv[0], &actions, nullptr, argv, environ);
  posix_spawn_file_actions_destroy(&actions);
  close(input[1]);
  close(output[1]);
  if (failure != 0) pid_ = -1;
  const json ports = json::parse(ReadLine(), nullptr, false);
  if (!ports.is_object()) {
    End();
    throw std::runtime_error("cannot start " + script);
  }
  port_ = ports.at("port");
  events_port_ = ports.at("events_port");
}

HaplyService::~HaplyService() { End(); }

void HaplyService::Set(const json& changes) { Ask("set", changes); }

json HaplyService::Report(int messages) { return Ask("report", {{"messages", messages}}); }

void HaplyService::SendEvent(const json& event) { Ask("event", event); }

void HaplyService::Restart(std::chrono::milliseconds absence) {
  Ask("restart", static_cast<double>(absence.count()) / 1000);
}

void HaplyService::Drop() { Ask("drop", json::object()); }

json HaplyService::Ask(const char* name, const json& value) {
  const std::lock_guard lock(mutex_);
  const std::string line = json{{name, value}}.dump() + "\n";
  for (std::size_t sent = 0; sent < line.size();) {
    const ssize_t count = send(commands_, line.data() + sent, line.size() - sent, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      ADD_FAILURE() << "the emulated service has ended; it cannot take " << line;
      return json::object();
    }
    sent += static_cast<std::size_t>(count);
  }
  const std::string text = ReadLine();
  json answer = json::parse(text, nullptr, false);
  if (!answer.is_object() || answer.contains("error")) {
    ADD_FAILURE() << "the emulated service answers \"" << text << "\" to " << line;
    return json::object();
  }
  return answer;
}

// Returns nothing if the emulator ends, or does not answer in time.
std::string HaplyService::ReadLine() {
  const auto deadline = std::chrono::steady_clock::now() + kAnswerPatience;
  std::size_t end = 0;
  while ((end = unread_.find('\n')) == std::string::npos) {
    pollfd file = {answers_, POLLIN, 0};
    poll(&file, 1, 100);
    char buffer[65536];
    if (file.revents != 0) {
      const ssize_t count = read(answers_, buffer, sizeof(buffer));
      if (count <= 0) return {};
      unread_.append(buffer, static_cast<std::size_t>(count));
    } else if (std::chrono::steady_clock::now() >= deadline) {
      return {};
    }
  }
  const std::string line = unread_.substr(0, end);
  unread_.erase(0, end + 1);
  return line;
}

void HaplyService::End() {
  close(commands_);
  close(answers_);
  if (pid_ <= 0) return;
  int status = 0;
  const bool ended =
      Eventually([&] { return waitpid(pid_, &status, WNOHANG) == pid_; }, kEndPatience);
  if (!ended) {
    kill(pid_, SIGKILL);
    waitpid(pid_, &status, 0);
  }
  pid_ = -1;
  if (!ended || status != 0) {
    ADD_FAILURE() << "the emulated service did not end in order, status " << status;
  }
}

}  // namespace palpate::test
