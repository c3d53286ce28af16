// The emergency stop's socket within palpated's server, and the client library that uses it.
// stop_door_test.cpp has the socket alone.
#include <gtest/gtest.h>
#include <sys/ptrace.h>
#include <sys/wait.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/sdk/calls.h"
#include "common/wire/address.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/process.h"
#include "tests/support/served_session.h"
#include "tests/support/stop_asking.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::AskToStop;

class StopServed : public ::testing::Test {
 protected:
  void Serve(DeviceList list = {}) {
    served_ = std::make_unique<testing::ServedSession>(socket_, LimitOptions{}, std::move(list));
    served_->server().Reserve();
    served_->data().Load("builtin:sphere:16");
    served_->data().Start();
    served_->server().Start();
  }

  const test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock", stop_ = StopSocketPath(socket_);
  std::unique_ptr<testing::ServedSession> served_;
};

// Stops a thread, as a debugger does. Returns false if it has just ended.
bool Freeze(pid_t thread) {
  if (ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) != 0) return false;
  ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr);
  return waitpid(thread, nullptr, __WALL) == thread;
}

TEST_F(StopServed, ItActsWhileAllOtherThreadsStand) {
  test::Process child({test::kStopChild, socket_});
  ASSERT_TRUE(child.WaitFor("ready"));
  int running = 0;
  std::vector<pid_t> frozen;
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(child.pid()) + "/task")) {
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
  const std::string answer = AskToStop(stop_);
  EXPECT_TRUE(answer.starts_with("stopped stop-call ")) << answer;
  EXPECT_EQ(AskToStop(stop_), answer);  // the forces are zero since then
  for (const pid_t thread : frozen) ptrace(PTRACE_DETACH, thread, nullptr, nullptr);
  child.Signal(SIGKILL);
  child.Wait();
}

TEST_F(StopServed, ItActsWhileTheServerShutsDownAndGoesWithIt) {
  std::promise<void> begun, ended;
  Serve([&] {
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
  EXPECT_TRUE(AskToStop(stop_).starts_with("stopped stop-call "));
  ended.set_value();
  ending.join();
  list.wait();
  EXPECT_FALSE(test::StopAsking(stop_).is_connected());
  EXPECT_FALSE(std::filesystem::exists(stop_));
}

TEST_F(StopServed, TheLibraryStopsThereAndByGrpcIfItIsMissing) {
  Serve();
  client::Calls calls({.address = {.socket_path = socket_}});
  const client::ForceResult stopped = calls.StopForces();
  EXPECT_EQ(stopped.forces.state, ForceState::kStopped);
  EXPECT_EQ(stopped.forces.reason, ForceReason::kStopCall);
  EXPECT_EQ(calls.GetDevice().forces.limit_n, stopped.forces.limit_n);
  EXPECT_EQ(calls.GetDevice().forces_set_by, "local socket");
  int told = 0;
  served_->stop_door().SetOnStop([&](const StopCaller&) { ++told; });
  calls.StopForces();
  served_->stop_door().TellStops();
  EXPECT_EQ(told, 1);
  // Of a palpated of the last release.
  std::filesystem::remove(stop_);
  calls.EnableForces();
  EXPECT_EQ(calls.StopForces().forces.state, ForceState::kStopped);
  served_->stop_door().TellStops();
  EXPECT_EQ(told, 1);
}

}  // namespace
}  // namespace palpate
