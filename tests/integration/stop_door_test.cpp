// The emergency stop's own socket: what it answers, in whatever state palpated is, and what it does
// with who floods it. python_stop_times_test.py measures it.
#include <gtest/gtest.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "client/sdk/calls.h"
#include "common/wire/address.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

constexpr char kStopped[] = "stopped stop-call ";

class Asking {
 public:
  explicit Asking(const std::string& socket) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, StopSocketPath(socket).c_str(), sizeof(address.sun_path) - 1);
    is_connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~Asking() { close(fd_); }
  Asking(const Asking&) = delete;
  Asking& operator=(const Asking&) = delete;

  void Send(std::string_view text) const { send(fd_, text.data(), text.size(), MSG_NOSIGNAL); }
  // Up to the end of the connection.
  std::string Answer() const {
    std::string all;
    char text[256];
    for (ssize_t got = 0; (got = recv(fd_, text, sizeof(text), 0)) > 0;) all.append(text, got);
    return all;
  }
  bool is_connected() const { return is_connected_; }

 private:
  const int fd_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  bool is_connected_ = false;
};

std::string Stop(const std::string& socket) {
  const Asking asking(socket);
  asking.Send("stop\n");
  return asking.Answer();
}

class StopDoorTest : public ::testing::Test {
 protected:
  void Serve(bool ticks = true, DeviceList list = {}) {
    served_ = std::make_unique<testing::ServedSession>(socket_, LimitOptions{}, std::move(list));
    served_->server().Reserve();
    served_->data().Load("builtin:sphere:16");
    if (ticks) served_->data().Start();
    served_->server().Start();
  }

  const test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock";
  std::unique_ptr<testing::ServedSession> served_;
};

// Stops a thread, as a debugger does. Returns false if it has just ended.
bool Freeze(pid_t thread) {
  if (ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) != 0) return false;
  ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr);
  return waitpid(thread, nullptr, __WALL) == thread;
}

TEST_F(StopDoorTest, ItActsWhileAllOtherThreadsStand) {
  test::Process child({test::kStopChild, socket_});
  ASSERT_TRUE(child.WaitFor("ready"));
  int running = 0;
  std::vector<pid_t> frozen;
  for (const auto& task : std::filesystem::directory_iterator(
           "/proc/" + std::to_string(child.pid()) + "/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm") >> std::ws, name);
    if (name == "palpate-rt" || name == "palpate-stop") {
      ++running;
    } else if (const pid_t thread = std::stoi(task.path().filename()); Freeze(thread)) {
      frozen.push_back(thread);
    }
  }
  EXPECT_EQ(running, 2);
  EXPECT_GT(frozen.size(), 20u);
  const std::string answer = Stop(socket_);
  EXPECT_TRUE(answer.starts_with(kStopped)) << answer;
  EXPECT_EQ(Stop(socket_), answer);  // the forces are zero since then
  for (const pid_t thread : frozen) ptrace(PTRACE_DETACH, thread, nullptr, nullptr);
  child.Signal(SIGKILL);
  child.Wait();
}

TEST_F(StopDoorTest, ItActsWhileTheServerShutsDownAndGoesWithIt) {
  std::promise<void> begun, ended;
  Serve(/*ticks=*/true, [&] {
    begun.set_value();
    ended.get_future().wait();
    return std::vector<ListedDevice>();
  });
  client::Calls calls({.address = {.socket_path = socket_}});
  auto list = calls.Async([](client::Calls& all) { return all.ListDevices(); });
  begun.get_future().wait();
  std::thread ending([this] { served_->server().Stop(); });
  EXPECT_TRUE(test::Eventually([&] {
    try {
      client::Calls({.address = {.socket_path = socket_}}).GetDevice();
      return false;
    } catch (const Error&) {
      return true;
    }
  }));
  EXPECT_TRUE(Stop(socket_).starts_with(kStopped));
  ended.set_value();
  ending.join();
  list.wait();
  EXPECT_FALSE(Asking(socket_).is_connected());
  EXPECT_FALSE(std::filesystem::exists(StopSocketPath(socket_)));
}

TEST_F(StopDoorTest, TheSocketIsForItsOwnerAndGroupAndTheStopIsKnownByItsUser) {
  Serve();
  struct stat info {};
  ASSERT_EQ(stat(StopSocketPath(socket_).c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0660u);
  client::Calls calls({.address = {.socket_path = socket_}});
  const client::ForceResult stopped = calls.StopForces();
  EXPECT_EQ(stopped.forces.state, ForceState::kStopped);
  EXPECT_EQ(stopped.forces.reason, ForceReason::kStopCall);
  EXPECT_EQ(calls.GetDevice().forces.limit_n, stopped.forces.limit_n);
  EXPECT_EQ(calls.GetDevice().forces_set_by, "local socket");
  int told = 0;
  served_->stop_door().SetOnStop([&](const StopCaller& by) {
    EXPECT_EQ(by.user, getuid());
    EXPECT_EQ(by.process, getpid());
    ++told;
  });
  calls.StopForces();
  served_->stop_door().TellStops();
  EXPECT_EQ(told, 1);
  // Of a palpated of the last release.
  std::filesystem::remove(StopSocketPath(socket_));
  calls.EnableForces();
  EXPECT_EQ(calls.StopForces().forces.state, ForceState::kStopped);
  served_->stop_door().TellStops();
  EXPECT_EQ(told, 1);
}

TEST_F(StopDoorTest, WhoSendsNothingOrSomethingElseTakesNoPlace) {
  Serve();
  std::vector<std::unique_ptr<Asking>> silent;
  for (std::size_t n = 0; n < 3 * StopDoor::kMostOpen; ++n) {
    silent.push_back(std::make_unique<Asking>(socket_));
    if (n % 3 == 1) silent.back()->Send("st");
  }
  EXPECT_EQ(silent.front()->Answer(), "");  // the oldest are closed
  for (const char* const other : {"STOP\n", "stop", "GET / HTTP/1.1\r\n\r\n", "\n", "stoq\n"}) {
    const Asking asking(socket_);
    asking.Send(other);
    if (std::string_view("stop") == other) continue;  // waits for the rest
    EXPECT_EQ(asking.Answer(), "") << other;
  }
  EXPECT_EQ(client::Calls({.address = {.socket_path = socket_}}).GetDevice().forces.state,
            ForceState::kOn);
  EXPECT_TRUE(Stop(socket_).starts_with(kStopped));
  const Asking slow(socket_);
  for (const char* const part : {"s", "to", "p", "\n"}) slow.Send(part);
  EXPECT_TRUE(slow.Answer().starts_with(kStopped));
}

TEST_F(StopDoorTest, ALoopThatDoesNotTickIsTold) {
  Serve(/*ticks=*/false);
  EXPECT_EQ(Stop(socket_), "waits\n");
  served_->data().Start();
  EXPECT_TRUE(Stop(socket_).starts_with("stopped stop-call 0 "));
  served_->data().Stop();
  EXPECT_TRUE(Stop(socket_).starts_with("stopped stop-call 0 "));
}

}  // namespace
}  // namespace palpate
