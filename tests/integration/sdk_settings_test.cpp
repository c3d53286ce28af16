// Settings by the client library: of one client, seen by others.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <mutex>

#include "client/sdk/client.h"
#include "tests/support/excuse.h"
#include "tests/support/patience.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::RestartedDaemon;
using Clock = std::chrono::steady_clock;

class SdkSettings : public ::testing::Test {
 protected:
  void SetUp() override { daemon_.Start(); }

  ClientOptions Options() const { return {.address = {.socket_path = daemon_.socket()}}; }

  RestartedDaemon daemon_;
};

TEST_F(SdkSettings, AnIsovalueArrivesAtOtherClients) {
  constexpr int kChanges = 200;
  std::mutex mutex;
  std::condition_variable wake;
  double seen = 0.0;
  Clock::time_point when;
  ClientOptions options = Options();
  options.callbacks.on_settings = [&](const Settings& settings) {
    const std::lock_guard lock(mutex);
    seen = settings.normalized_isovalue;
    when = Clock::now();
    wake.notify_all();
  };
  Client watcher(options);
  Client setter(Options());
  ASSERT_TRUE(watcher.WaitUntilConnected(60s) && setter.WaitUntilConnected(60s));
  ASSERT_TRUE(Eventually([&] { return watcher.NewestPose().has_value(); }));
  double p99_ms = 1000.0;
  // A machine that stops twice in a round makes its p99; clients that are late make each.
  for (int round = 0; round < 3 && p99_ms >= 100.0; ++round) {
    std::vector<double> delays_ms;
    for (int n = 0; n < kChanges; ++n) {
      const double value = 0.3 + 0.1 * round + 0.1 * n / kChanges;
      const auto begin = Clock::now();
      setter.Set({.normalized_isovalue = value});
      std::unique_lock lock(mutex);
      ASSERT_TRUE(wake.wait_for(lock, 20s, [&] { return std::abs(seen - value) < 1e-6; }));
      delays_ms.push_back(std::chrono::duration<double, std::milli>(when - begin).count());
      // Not in step with the poses.
      lock.unlock();
      std::this_thread::sleep_for(std::chrono::milliseconds(n % 17));
    }
    std::sort(delays_ms.begin(), delays_ms.end());
    p99_ms = delays_ms[delays_ms.size() * 99 / 100];
    std::printf("seen by another client: median %.1f ms, p99 %.1f ms\n",
                delays_ms[delays_ms.size() / 2], p99_ms);
  }
  EXPECT_LT(p99_ms, 100.0) << test::kBusyMachine;
}

TEST_F(SdkSettings, WhatComesLastIsWhatAllKnow) {
  std::vector<std::unique_ptr<Client>> clients;
  for (int n = 0; n < 3; ++n) clients.push_back(std::make_unique<Client>(Options()));
  for (const auto& client : clients) ASSERT_TRUE(client->WaitUntilConnected(60s));
  std::vector<std::thread> setters;
  for (int n = 0; n < 3; ++n) {
    setters.emplace_back([&, n] {
      for (int i = 0; i < 100; ++i) {
        clients[n]->Set({.viscosity_n_s_per_m = n + 0.01 * i});
        if (i % 10 == n) std::this_thread::sleep_for(20ms);
      }
    });
  }
  for (std::thread& setter : setters) setter.join();
  const Settings last = clients[0]->GetSettings();
  for (const auto& client : clients) {
    EXPECT_TRUE(
        Eventually([&] { return client->NewestSettings()->revision == last.revision; }, 5s));
    EXPECT_EQ(client->NewestSettings()->viscosity_n_s_per_m, last.viscosity_n_s_per_m);
  }
}

TEST_F(SdkSettings, RevisionsAreReportedOnceAndRise) {
  std::mutex mutex;
  std::vector<std::uint64_t> revisions;
  ClientOptions options = Options();
  options.callbacks.on_settings = [&](const Settings& settings) {
    const std::lock_guard lock(mutex);
    revisions.push_back(settings.revision);
  };
  Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  for (int n = 0; n < 100; ++n) client.Set({.magnet_range_mm = 1.0 + 0.01 * n});
  const std::uint64_t last = client.GetSettings().revision;
  EXPECT_TRUE(Eventually([&] {
    const std::lock_guard lock(mutex);
    return !revisions.empty() && revisions.back() == last;
  }));
  const std::lock_guard lock(mutex);
  EXPECT_TRUE(std::adjacent_find(revisions.begin(), revisions.end(), std::greater_equal()) ==
              revisions.end());
}

TEST_F(SdkSettings, RefusalsAreTheDaemonsOwnLines) {
  Client client(Options());
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  const auto refusal = [](const auto& call) {
    try {
      call();
    } catch (const Error& error) {
      EXPECT_FALSE(std::string(error.what()).empty());
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.kind();
    }
    return ErrorKind::kInternal;
  };
  EXPECT_EQ(refusal([&] { client.Set({.stiffness_n_per_mm = 99.0}); }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal([&] { client.Set({}); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal([&] { client.Set({.isovalue = 0.5, .expected_revision = 999999}); }),
            ErrorKind::kConflict);
  EXPECT_EQ(refusal([&] { client.Undo(); }), ErrorKind::kConflict);
  EXPECT_EQ(refusal([&] { client.GetSeries(); }), ErrorKind::kConflict);
  EXPECT_EQ(refusal([&] { client.StartRecording("relative"); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal([&] { client.EnableForces("falcon"); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
}

TEST_F(SdkSettings, ForcesStopAndComeBack) {
  Client client(Options());
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  EXPECT_EQ(client.GetDevice().device.verification_level, VerificationLevel::kSimulated);
  const ForceResult stopped = client.StopForces();
  EXPECT_EQ(stopped.forces.state, ForceState::kStopped);
  EXPECT_EQ(stopped.forces.reason, ForceReason::kStopCall);
  ASSERT_TRUE(Eventually([&] {
    const auto pose = client.NewestPose();
    return pose && pose->tick >= stopped.applied_tick;
  }));
  EXPECT_EQ(client.NewestPose()->forces.state, ForceState::kStopped);
  EXPECT_EQ(client.NewestPose()->force_n.norm(), 0.0);
  client.EnableForces();
  EXPECT_TRUE(Eventually([&] { return client.NewestPose()->forces.state == ForceState::kOn; }));
  EXPECT_EQ(client.DisableForces().forces.reason, ForceReason::kOperator);
}

}  // namespace
}  // namespace palpate::client
