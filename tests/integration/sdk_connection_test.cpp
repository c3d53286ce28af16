// The client library: found, lost, found again, and ended at any moment.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <mutex>

#include "client/sdk/client.h"
#include "tests/support/excuse.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/restarted_daemon.h"
#include "tests/support/temporary_folder.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::RestartedDaemon;
using Clock = std::chrono::steady_clock;

// Every connection that was reported.
class Log {
 public:
  std::function<void(const Connection&)> Callback() {
    return [this](const Connection& connection) {
      const std::lock_guard lock(mutex_);
      seen_.push_back(connection);
    };
  }
  std::vector<Connection> seen() const {
    const std::lock_guard lock(mutex_);
    return seen_;
  }
  std::size_t Count(ConnectionState state) const {
    const std::vector<Connection> all = seen();
    return std::count_if(all.begin(), all.end(),
                         [state](const auto& c) { return c.state == state; });
  }

 private:
  mutable std::mutex mutex_;
  std::vector<Connection> seen_;
};

ClientOptions On(const std::string& socket) { return {.address = {.socket_path = socket}}; }

TEST(SdkConnection, BadAddressesAndRatesAreRefusedAtOnce) {
  const auto kind = [](const ClientOptions& options) {
    try {
      const Client client(options);
      return ErrorKind::kInternal;
    } catch (const Error& error) {
      return error.kind();
    }
  };
  EXPECT_EQ(kind({.address = {.host_port = "nonsense"}}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(kind({.address = {.socket_path = "/tmp/a b"}}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(kind({.address = {.socket_path = "/tmp/a", .host_port = "localhost:7400"}}),
            ErrorKind::kInvalidArgument);
  for (const double rate_hz : {0.0, 19.9, 1000.1, -1.0, std::nan("")}) {
    EXPECT_EQ(kind({.address = {.socket_path = "/tmp/a"}, .poses = {.rate_hz = rate_hz}}),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(kind({.address = {.socket_path = "/tmp/a"}, .poses = {.rate_hz = 60, .batch = 4}}),
            ErrorKind::kInvalidArgument);
}

TEST(SdkConnection, EndsWhileConnectingToNothing) {
  const test::TemporaryFolder folder;
  for (const auto pause : {0ms, 1ms, 20ms, 300ms}) {
    auto client = std::make_unique<Client>(On(folder.path() / "none.sock"));
    std::this_thread::sleep_for(pause);
    const auto begin = Clock::now();
    client.reset();
    EXPECT_LT(Clock::now() - begin, 1s) << test::kBusyMachine;
  }
}

// Accepts connections and says nothing: a client waits for an answer all the time.
TEST(SdkConnection, EndsWhileWaitingForAMuteServer) {
  const int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  ASSERT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), length), 0);
  ASSERT_EQ(listen(listener, 8), 0);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &length);
  const std::string host_port = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  for (const auto pause : {0ms, 5ms, 200ms, 1000ms}) {
    auto client = std::make_unique<Client>(
        ClientOptions{.address = {.host_port = host_port}, .follow_volume = true});
    EXPECT_FALSE(client->WaitUntilConnected(pause));
    const auto begin = Clock::now();
    client.reset();
    EXPECT_LT(Clock::now() - begin, 1s) << test::kBusyMachine;
  }
  close(listener);
}

TEST(SdkConnection, SaysWhyItIsNotConnected) {
  const test::TemporaryFolder folder;
  Client client(On(folder.path() / "none.sock"));
  ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
  EXPECT_EQ(client.connection().why,
            "no palpated at " + client.name() + ": start it with 'palpated'");
  EXPECT_FALSE(client.NewestPose() || client.NewestSettings());
  const auto begin = Clock::now();
  try {
    client.Set({.isovalue = 1.0});
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUnavailable);
  }
  EXPECT_LT(Clock::now() - begin, 6s) << test::kBusyMachine;
}

TEST(SdkConnection, FindsADaemonThatStartsLater) {
  RestartedDaemon daemon;
  Log log;
  ClientOptions options = On(daemon.socket());
  options.callbacks.on_connection = log.Callback();
  Client client(options);
  std::this_thread::sleep_for(1s);
  daemon.Start();
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  EXPECT_TRUE(client.NewestSettings());
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  EXPECT_EQ(log.Count(ConnectionState::kConnected), 1u);
  EXPECT_GE(log.Count(ConnectionState::kLost), 1u);
}

TEST(SdkConnection, ComesBackAfterEveryKill) {
  RestartedDaemon daemon;
  daemon.Start();
  Log log;
  std::atomic<int> settings{0};
  ClientOptions options = On(daemon.socket());
  options.callbacks.on_connection = log.Callback();
  options.callbacks.on_settings = [&](const Settings&) { ++settings; };
  Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  for (int n = 1; n <= 3; ++n) {
    ASSERT_TRUE(
        Eventually([&] { return log.Count(ConnectionState::kConnected) == std::size_t(n); }));
    ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
    // Anything but the start value, so that what is forgotten is seen.
    client.Set({.stiffness_n_per_mm = 0.7});
    daemon.Kill();
    ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
    EXPECT_FALSE(client.connection().why.empty());
    EXPECT_TRUE(client.NewestPose());
    daemon.Start();
    ASSERT_TRUE(client.WaitUntilConnected(60s));
    // Of the new daemon, though their revision is lower.
    EXPECT_EQ(client.NewestSettings()->stiffness_n_per_mm, 0.5);
    EXPECT_EQ(client.GetDevice().servo.rate_hz, 1000.0);
  }
  EXPECT_GE(settings, 4);
  // From connected to lost and back, and never the same state twice without another
  // reason.
  const std::vector<Connection> seen = log.seen();
  for (std::size_t n = 1; n < seen.size(); ++n) {
    EXPECT_TRUE(seen[n].state != seen[n - 1].state || seen[n].why != seen[n - 1].why);
  }
}

// No attempt is in vain: gRPC's own channels keep failing for a while after the daemon
// is back. Pauses double and are shortened by a half at most, so that the one that runs
// lasts no longer than twice the time without a daemon, and 0.1 s.
TEST(SdkConnection, IsBackAfterThePauseThatRuns) {
  RestartedDaemon daemon;
  daemon.Start();
  const Client client(On(daemon.socket()));
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  int in_time = 0;
  for (int n = 0; n < 5; ++n) {
    // Poses have come again, after which the pauses begin anew.
    const std::uint64_t tick = client.NewestPose() ? client.NewestPose()->tick : 0;
    ASSERT_TRUE(
        Eventually([&] { return client.NewestPose() && client.NewestPose()->tick != tick; }));
    daemon.Kill();
    ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
    const auto lost = Clock::now();
    std::this_thread::sleep_for(1s);
    daemon.Start();
    const auto ready = Clock::now();
    ASSERT_TRUE(client.WaitUntilConnected(60s));
    const std::chrono::duration<double> down = ready - lost, took = Clock::now() - ready;
    std::printf("down for %.2f s, back after %.2f s\n", down.count(), took.count());
    in_time += took.count() < 2.0 * down.count() + 0.1 + 0.3;
  }
  EXPECT_GE(in_time, 4) << test::kBusyMachine;
}

TEST(SdkConnection, NoticesADaemonThatHangs) {
  RestartedDaemon daemon;
  daemon.Start();
  Client client(On(daemon.socket()));
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  daemon.Hang();
  EXPECT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
  EXPECT_EQ(client.connection().why, "palpated at " + client.name() + " does not answer");
  daemon.Continue();
  EXPECT_TRUE(client.WaitUntilConnected(60s));
}

TEST(SdkConnection, NoCallbackRunsAfterTheEnd) {
  RestartedDaemon daemon;
  daemon.Start();
  int ended_with_poses = 0;
  for (int n = 0; n < 30; ++n) {
    std::atomic<bool> ended{false};
    std::atomic<int> late{0}, poses{0};
    const auto note = [&](const auto&...) { late += ended; };
    ClientOptions options = On(daemon.socket());
    options.poses.rate_hz = 1000.0;
    options.follow_volume = true;
    options.callbacks = {.on_connection = note,
                         .on_poses =
                             [&](const PoseBatch&) {
                               std::this_thread::sleep_for(3ms);
                               late += ended;
                               ++poses;
                             },
                         .on_settings = note,
                         .on_volume = note};
    auto client = std::make_unique<Client>(options);
    if (n % 2) {
      EXPECT_TRUE(Eventually([&] { return poses > 0; }));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(n * 7));
    client.reset();
    ended = true;
    std::this_thread::sleep_for(10ms);
    EXPECT_EQ(late, 0);
    ended_with_poses += poses > 0;
  }
  EXPECT_GE(ended_with_poses, 15);
}

TEST(SdkConnection, CallsFromCallbacksWork) {
  RestartedDaemon daemon;
  daemon.Start();
  std::atomic<Client*> self{nullptr};
  std::atomic<int> answers{0};
  ClientOptions options = On(daemon.socket());
  const auto ask = [&](const auto&...) {
    if (Client* client = self) answers += client->GetSettings().stiffness_n_per_mm > 0.0;
  };
  options.callbacks.on_poses = ask;
  options.callbacks.on_settings = ask;
  Client client(options);
  self = &client;
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  client.Set({.viscosity_n_s_per_m = 1.0});
  EXPECT_TRUE(Eventually([&] { return answers > 10; }));
  self = nullptr;
}

// Reached over TCP, and by many threads at once.
TEST(SdkConnection, ManyThreadsOverTcp) {
  const std::string host_port = "127.0.0.1:" + std::to_string(test::FreePort());
  const test::TemporaryFolder folder;
  const std::filesystem::path config = folder.path() / "palpated.toml";
  std::ofstream(config) << "[server]\nloopback_role = \"editor\"\n";
  RestartedDaemon daemon(
      {"--volume", "builtin:bumps:32", "--listen", host_port, "--config", config});
  daemon.Start();
  Client client({.address = {.host_port = host_port}});
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  EXPECT_EQ(client.name(), host_port);
  EXPECT_FALSE(client.shares_clock());
  std::atomic<int> answers{0};
  std::vector<std::thread> threads;
  for (int n = 0; n < 6; ++n) {
    threads.emplace_back([&, n] {
      for (int i = 0; i < 20; ++i) {
        client.Set({.magnet_range_mm = 1.0 + n});
        if (n == 0) client.SetPoseRate({.rate_hz = i % 2 == 0 ? 60.0 : 500.0});
        client.NewestPose();
        answers += client.GetDevice().device.kind == "simulated";
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(answers, 120);
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
}

}  // namespace
}  // namespace palpate::client
