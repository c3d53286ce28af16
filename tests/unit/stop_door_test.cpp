// The emergency stop's own socket: what it answers, and what it does with who floods it.
// stop_served_test.cpp has it within palpated's server; python_stop_times_test.py measures it.
#include "server/stop/stop_door.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "server/pump/tick_outbox.h"
#include "tests/support/patience.h"
#include "tests/support/running_session.h"
#include "tests/support/stop_asking.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::AskToStop;
using test::StopAsking;

constexpr char kStopped[] = "stopped stop-call ";

// Its close waits for a second, for a peer that does not read.
int LingeringSocket() {
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  bind(listener, reinterpret_cast<sockaddr*>(&address), length);
  listen(listener, 1);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &length);
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  EXPECT_EQ(connect(fd, reinterpret_cast<sockaddr*>(&address), length), 0);
  const std::string more(1 << 20, 'a');
  while (send(fd, more.data(), more.size(), MSG_DONTWAIT) > 0) {
  }
  const linger lingering{1, 1};
  setsockopt(fd, SOL_SOCKET, SO_LINGER, &lingering, sizeof(lingering));
  return fd;  // the listener stays, until the test's process ends
}

class StopDoorTest : public ::testing::Test {
 protected:
  StopDoorTest() {
    data_.Load("builtin:sphere:16");
    door_.SetOnStop([this](const StopCaller& by) {
      EXPECT_EQ(by.user, getuid());
      EXPECT_EQ(by.process, getpid());
      by_door_ = by.by_door.data();
      ++told_;
    });
    door_.Open({{path_}, {.path = door_path_, .is_door = true}});
  }
  ForceState state() { return ForceWatch(data_.outbox().last).newest()->forces.state; }

  const test::TemporaryFolder folder_;
  const std::string path_ = folder_.path() / "stop.sock";
  const std::string door_path_ = folder_.path() / "door-stop.sock";
  testing::RunningSession data_;
  std::atomic<int> told_{0};
  std::string by_door_;  // after TellStops
  StopDoor door_{data_.servo(), data_.outbox().last, data_.simulated(), 1};
};

TEST_F(StopDoorTest, IsForItsOwnerAndGroupTellsWhoHasStoppedAndGoes) {
  data_.Start();
  struct stat info {};
  ASSERT_EQ(stat(path_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0660u);
  const std::string answer = AskToStop(path_);
  EXPECT_TRUE(answer.starts_with(kStopped)) << answer;
  EXPECT_EQ(state(), ForceState::kStopped);
  EXPECT_EQ(AskToStop(path_), answer);  // the forces are zero since then
  door_.TellStops();
  EXPECT_EQ(told_, 2);
  door_.Close();
  EXPECT_FALSE(StopAsking(path_).is_connected());
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(StopDoorTest, ADoorAsksAsAProxyCanAndSaysWhoCalls) {
  data_.Start();
  struct stat info {};
  ASSERT_EQ(stat(door_path_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777, 0600u);
  const auto ask = [](const std::string& path, const std::string& request) {
    const StopAsking asking(path);
    asking.Send(request);
    return asking.Answer();
  };
  EXPECT_EQ(ask(door_path_, "stop\n"), "");
  EXPECT_EQ(ask(path_, "stop / HTTP/1.0\r\n\r\n"), "");
  EXPECT_NE(state(), ForceState::kStopped);
  const std::string answer =
      ask(door_path_, "stop /192.0.2.7:5/token ada HTTP/1.0\r\nHost: x\r\n\r\n");
  EXPECT_TRUE(answer.starts_with("HTTP/1.0 200 OK\r\nContent-Length: ")) << answer;
  EXPECT_NE(answer.find("\r\n\r\n6 "), std::string::npos) << answer;
  EXPECT_EQ(state(), ForceState::kStopped);
  door_.TellStops();
  EXPECT_EQ(by_door_, "192.0.2.7:5/token ada");
  // As much of a name as there is room for.
  EXPECT_NE(ask(door_path_, "stop /1/" + std::string(1000, 'a')), "");
  door_.TellStops();
  EXPECT_EQ(by_door_, "1/" + std::string(125, 'a'));
}

TEST_F(StopDoorTest, WhoSendsNothingOrSomethingElseTakesNoPlaceAndStopsNothing) {
  data_.Start();
  data_.AwaitTicks(2);
  std::vector<std::unique_ptr<StopAsking>> silent;
  for (std::size_t n = 0; n < 3 * StopDoor::kMostOpen; ++n) {
    silent.push_back(std::make_unique<StopAsking>(path_));
    if (n % 3 == 1) silent.back()->Send("sto");
  }
  EXPECT_EQ(silent.front()->Answer(), "");  // the oldest are closed
  for (const std::string_view other :
       {"STOP\n", "GET / HTTP/1.1\r\n\r\n", "\n", "stoq\n", "sto", "stop"}) {
    const StopAsking asking(path_);
    asking.Send(other);
    EXPECT_EQ(asking.Answer(), "") << other;
  }
  data_.AwaitTicks(2);
  EXPECT_NE(state(), ForceState::kStopped);
  EXPECT_TRUE(AskToStop(path_).starts_with(kStopped));
}

// A file that comes with the bytes may take long to close. Linux from 6.16 on takes none.
TEST_F(StopDoorTest, FilesThatArePassedAreClosedElsewhere) {
  data_.Start();
  const int lingering = LingeringSocket();
  {
    const StopAsking attacker(path_);
    attacker.SendFile("x", lingering);
    close(lingering);
    for (int n = 0; n < 20; ++n) EXPECT_TRUE(AskToStop(path_).starts_with(kStopped));
  }
  for (int n = 0; n < 20; ++n) EXPECT_TRUE(AskToStop(path_).starts_with(kStopped));
}

// Nobody who has asked loses its answer to those who have not.
TEST_F(StopDoorTest, ACrowdOfSilentOnesTakesNoAnswers) {
  data_.Start();
  std::atomic<bool> ends = false;
  std::thread crowd([&] {
    std::vector<std::unique_ptr<StopAsking>> silent;
    while (!ends) {
      silent.push_back(std::make_unique<StopAsking>(path_));
      if (silent.size() > 300) silent.erase(silent.begin());
    }
  });
  for (int n = 0; n < 200; ++n) EXPECT_TRUE(AskToStop(path_).starts_with(kStopped));
  ends = true;
  crowd.join();
}

TEST_F(StopDoorTest, ALoopThatDoesNotTickIsTold) {
  EXPECT_EQ(AskToStop(path_), "waits\n");
  data_.Start();
  EXPECT_TRUE(AskToStop(path_).starts_with("stopped stop-call 0 "));
  data_.Stop();
  EXPECT_TRUE(AskToStop(path_).starts_with("stopped stop-call 0 "));
}

// Somebody enables the forces all the time: each stop has acted all the same.
TEST_F(StopDoorTest, ActsForAllOfManyBesideWhoEnables) {
  data_.Start();
  std::atomic<bool> ends = false;
  std::thread enabling([&] {
    while (!ends) data_.servo().forces().Set(ForceCommand::kEnable);
  });
  std::atomic<int> wrong = 0;
  test::OnThreads(4, [&](int) {
    unsigned long before = 0;
    for (int n = 0; n < 50; ++n) {
      char state[16], reason[16];
      unsigned long tick = 0;
      const std::string answer = AskToStop(path_);
      const bool is_whole = std::sscanf(answer.c_str(), "%15s %15s %lu", state, reason, &tick) == 3;
      if (!is_whole || tick < before) ++wrong;
      before = tick;
    }
  });
  ends = true;
  enabling.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_TRUE(AskToStop(path_).starts_with(kStopped));
}

}  // namespace
}  // namespace palpate
