// Poses and settings that the client library hands on: as they are asked for, each loss counted.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <thread>

#include "client/sdk/client.h"
#include "tests/support/heard.h"
#include "tests/support/patience.h"
#include "tests/support/restarted_daemon.h"
#include "tests/support/stolen.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::Heard;

std::vector<Pose> PosesOf(const std::vector<PoseBatch>& batches) {
  std::vector<Pose> poses;
  for (const PoseBatch& batch : batches) {
    poses.insert(poses.end(), batch.poses.begin(), batch.poses.end());
  }
  return poses;
}

// From each pose to the next in loop time: ticks, with those that the loop missed.
std::vector<std::uint64_t> StepsOf(const std::vector<Pose>& poses) {
  std::vector<std::uint64_t> steps;
  for (std::size_t n = 1; n < poses.size(); ++n) {
    steps.push_back(poses[n].tick + poses[n].missed_ticks - poses[n - 1].tick -
                    poses[n - 1].missed_ticks);
  }
  return steps;
}

class SdkStreams : public ::testing::Test {
 protected:
  void SetUp() override { daemon_.Start(); }
  ClientOptions Options() const { return {.address = {.socket_path = daemon_.socket()}}; }

  test::RestartedDaemon daemon_;
};

TEST_F(SdkStreams, PosesComeAtTheRateThatIsAskedForWhileItChanges) {
  Heard<PoseBatch> heard;
  ClientOptions options = Options();
  options.poses.rate_hz = 20;
  options.callbacks.on_poses = heard.Callback();
  Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  EXPECT_TRUE(client.shares_clock());
  ASSERT_TRUE(Eventually([&] { return PosesOf(heard.all()).size() > 20; }));
  EXPECT_NEAR(client.NewestPose()->stylus_orientation.norm(), 1.0, 1e-6);
  EXPECT_TRUE(Eventually([&] { return client.NewestPose()->forces.state == ForceState::kOn; }));
  client.SetPoseRate({.rate_hz = 1000});
  ASSERT_TRUE(Eventually([&] {
    const std::vector<std::uint64_t> steps = StepsOf(PosesOf(heard.all()));
    return std::count(steps.begin(), steps.end(), 1u) > 200;
  }));
  const std::vector<Pose> poses = PosesOf(heard.all());
  const std::vector<std::uint64_t> steps = StepsOf(poses);
  // One of each 50 ms of loop time. A tick that the loop missed makes a sample late, and the
  // next step shorter, but never a second sample of the same 50 ms.
  std::uint64_t since_first = 0;
  for (std::uint64_t n = 0; n < 19; ++n) {
    since_first += steps[n];
    EXPECT_GT(since_first, 50 * n) << "pose " << n + 1;
  }
  EXPECT_THROW(client.SetPoseRate({.rate_hz = 5}), Error);
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > poses.back().tick; }));
}

TEST_F(SdkStreams, BatchesAreFullAndEveryLossIsCounted) {
  for (const auto& [rate, step] :
       {std::pair{PoseRate{60, 1}, 17u}, std::pair{PoseRate{1000, 10}, 1u}}) {
    Heard<PoseBatch> heard;
    ClientOptions options = Options();
    options.poses = rate;
    options.callbacks.on_poses = heard.Callback();
    auto client = std::make_unique<Client>(options);
    ASSERT_TRUE(Eventually([&] { return heard.all().size() > 100; }));
    client.reset();
    // A callback that comes late gets several messages at once.
    for (const PoseBatch& batch : heard.all())
      EXPECT_EQ(batch.poses.size() % std::size_t(rate.batch), 0u);
    const std::vector<Pose> poses = PosesOf(heard.all());
    std::size_t gaps = 0;
    for (std::size_t n = 1; n < poses.size(); ++n) {
      ASSERT_GT(poses[n].tick, poses[n - 1].tick);
      gaps += poses[n].tick - poses[n - 1].tick > step;
    }
    EXPECT_LE(gaps, heard.all().back().dropped);
  }
}

TEST_F(SdkStreams, OfSettingsThatManySetAllKnowTheLast) {
  constexpr int kClients = 3;
  Heard<Settings> heard[kClients];
  std::vector<std::unique_ptr<Client>> clients;
  for (Heard<Settings>& own : heard) {
    ClientOptions options = Options();
    options.callbacks.on_settings = own.Callback();
    clients.push_back(std::make_unique<Client>(options));
  }
  for (const auto& client : clients) ASSERT_TRUE(client->WaitUntilConnected(60s));
  std::vector<std::thread> setters;
  for (int n = 0; n < kClients; ++n) {
    setters.emplace_back([&, n] {
      for (int i = 0; i < 100; ++i) {
        clients[n]->Set({.viscosity_n_s_per_m = n + 0.01 * i});
        if (i % 10 == n) std::this_thread::sleep_for(20ms);
      }
    });
  }
  for (std::thread& setter : setters) setter.join();
  const Settings last = clients[0]->GetSettings();
  for (int n = 0; n < kClients; ++n) {
    EXPECT_TRUE(Eventually([&] {
      const std::vector<Settings> all = heard[n].all();
      return !all.empty() && all.back().revision == last.revision;
    }));
    EXPECT_EQ(clients[n]->NewestSettings()->viscosity_n_s_per_m, last.viscosity_n_s_per_m);
    // Each is reported once, and none after a newer one.
    const std::vector<Settings> all = heard[n].all();
    EXPECT_EQ(std::adjacent_find(
                  all.begin(), all.end(),
                  [](const Settings& a, const Settings& b) { return a.revision >= b.revision; }),
              all.end());
  }
}

class SdkStreamTimes : public SdkStreams {};

// Two clients of one daemon at the same time, of which one takes 0.5 s for each callback.
TEST_F(SdkStreamTimes, ASlowCallbackLosesPosesAndSeesTheFreshOnes) {
  const test::StolenShare stolen;
  constexpr int kTakesMs = 500;
  Heard<PoseBatch> fast, slow;
  std::vector<double> ages_ms;
  ClientOptions options = Options();
  options.poses.rate_hz = 1000;
  options.callbacks.on_poses = fast.Callback();
  auto fast_client = std::make_unique<Client>(options);
  options.callbacks.on_poses = [&, keep = slow.Callback()](const PoseBatch& batch) {
    const std::chrono::nanoseconds now = std::chrono::steady_clock::now().time_since_epoch();
    ages_ms.push_back(1e-6 * static_cast<double>(now.count() - batch.poses.back().time_ns));
    keep(batch);
    std::this_thread::sleep_for(std::chrono::milliseconds(kTakesMs));
  };
  auto slow_client = std::make_unique<Client>(options);
  ASSERT_TRUE(Eventually([&] { return slow.all().size() >= 16; }));
  slow_client.reset();
  fast_client.reset();
  const std::uint64_t fast_lost = fast.all().back().dropped;
  const std::uint64_t slow_lost = slow.all().back().dropped;
  std::sort(ages_ms.begin(), ages_ms.end());
  const double age_ms = ages_ms[ages_ms.size() / 2];
  std::printf("lost: %llu fast, %llu slow; the slow one's age %.0f ms\n",
              static_cast<unsigned long long>(fast_lost),
              static_cast<unsigned long long>(slow_lost), age_ms);
  EXPECT_GT(slow_lost, 2000u);
  EXPECT_LT(fast_lost, slow_lost / 5);
  // Far less than the time of a callback.
  EXPECT_LT(age_ms, 0.2 * kTakesMs);
}

}  // namespace
}  // namespace palpate::client
