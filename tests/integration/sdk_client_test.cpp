// The client that follows palpated by itself: found, lost, found again, and ended at any moment;
// the voxels that it follows; the poses and settings that it hands on.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "client/sdk/client.h"
#include "tests/support/daemon.h"
#include "tests/support/free_port.h"
#include "tests/support/heard.h"
#include "tests/support/live_view.h"
#include "tests/support/places.h"
#include "tests/support/refusal.h"
#include "tests/support/restarted_daemon.h"
#include "tests/support/stolen.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/throttle.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::BricksOf;
using test::Eventually;
using test::Heard;
using test::RestartedDaemon;
using testing::Refusal;
using Clock = std::chrono::steady_clock;

ClientOptions OnSocket(const std::string& path) { return {.address = {.socket_path = path}}; }
ClientOptions FollowingOn(const std::string& path) {
  return {.address = {.socket_path = path}, .follow_volume = true};
}

bool IsLost(const Client& client) {
  return Eventually([&] { return client.connection().state == ConnectionState::kLost; });
}

// What a viewer keeps of the updates of a volume.
class Viewer {
 public:
  // True where the copy is complete, and that of `revision` at least.
  bool Take(Client& client, std::uint64_t revision) {
    while (const auto update = client.TakeVolumeUpdate()) {
      anew_ += update->all && update->lattice;
      for (const BrickRun& run : update->changed) received_ += run.count;
      volume_.Take(*update);
    }
    return volume_.revision() && volume_.revision()->volume_revision >= revision;
  }
  // A client that comes anew holds the daemon's volume: its hash has shown that.
  bool IsTheVolumeOf(const RestartedDaemon& daemon, std::uint64_t revision) const {
    Client fresh(FollowingOn(daemon.socket()));
    Viewer truth;
    return Eventually([&] { return truth.Take(fresh, revision); }) &&
           BricksOf(volume_) == BricksOf(truth.volume_);
  }
  const view::ViewVolume& volume() const { return volume_; }
  std::size_t received() const { return received_; }
  int anew() const { return anew_; }

 private:
  view::ViewVolume volume_;
  std::size_t received_ = 0;
  int anew_ = 0;
};

Edit Dab(int n) {
  return {.shape = Sphere{Vec3(6 + n * 7 % 36, 6 + n * 11 % 36, 6 + n * 13 % 36), 4.0},
          .frame = EditFrame::kIndex,
          .operation = EditOperation::kSet,
          .value = 0.1 + 0.8 * (n % 10) / 10,
          .falloff = 1.0};
}

TEST(SdkOptions, BadAddressesAndRatesAreRefusedAtOnce) {
  std::vector<ClientOptions> bad = {
      {.address = {.host_port = "nonsense"}},
      {.address = {.socket_path = "/tmp/a b"}},
      {.address = {.socket_path = "/tmp/a", .host_port = "localhost:7400"}},
      {.address = {.socket_path = "/tmp/a"}, .poses = {.rate_hz = 60, .batch = 4}}};
  for (const double rate_hz : {0.0, 19.9, 1000.1, -1.0, std::nan("")}) {
    bad.push_back({.address = {.socket_path = "/tmp/a"}, .poses = {.rate_hz = rate_hz}});
  }
  for (const ClientOptions& options : bad) {
    EXPECT_EQ(Refusal([&] { const Client client(options); }), ErrorKind::kInvalidArgument);
  }
}

class SdkClient : public ::testing::Test {
 protected:
  ClientOptions Options() const { return OnSocket(daemon_.socket()); }
  ClientOptions Following() const { return FollowingOn(daemon_.socket()); }

  RestartedDaemon daemon_;
};

TEST_F(SdkClient, EndsAtAnyMomentWithoutAnAnswer) {
  daemon_.Start();
  daemon_.Hang();  // it accepts connections still, and says nothing
  for (const ClientOptions& options : {OnSocket(daemon_.folder() / "none.sock"), Following()}) {
    for (const auto pause : {0ms, 1ms, 20ms, 300ms}) {
      const Client client(options);
      EXPECT_FALSE(client.WaitUntilConnected(pause));
    }
  }
}

TEST_F(SdkClient, FindsALaterDaemonAndComesBackAfterEveryKill) {
  Heard<Connection> connections;
  std::atomic<int> settings{0};
  ClientOptions options = Following();
  options.callbacks.on_connection = connections.Callback();
  options.callbacks.on_settings = [&](const Settings&) { ++settings; };
  Client client(options);
  ASSERT_TRUE(IsLost(client));
  EXPECT_NE(client.connection().why.find(client.name()), std::string::npos);
  EXPECT_FALSE(client.NewestPose() || client.NewestSettings());
  EXPECT_EQ(Refusal([&] { client.Set({.isovalue = 1.0}); }), ErrorKind::kUnavailable);
  Viewer viewer;
  for (int n = 1; n <= 3; ++n) {
    daemon_.Start();
    ASSERT_TRUE(client.WaitUntilConnected(60s));
    // Of the new daemon, though their revision is lower.
    EXPECT_TRUE(Eventually([&] { return client.NewestSettings()->stiffness_n_per_mm == 0.5; }));
    EXPECT_EQ(client.GetDevice().servo.rate_hz, 1000.0);
    ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
    // Its voxels are those before the edit, which it never saw.
    ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1) && viewer.anew() == n; }));
    EXPECT_TRUE(viewer.IsTheVolumeOf(daemon_, 1));
    if (n == 3) break;
    // Anything but the start values, so that what is forgotten is seen.
    client.Set({.stiffness_n_per_mm = 0.7});
    const EditResult edited = client.Apply(Dab(n));
    ASSERT_TRUE(Eventually([&] { return viewer.Take(client, edited.volume_revision); }));
    daemon_.Kill();
    ASSERT_TRUE(IsLost(client));
    EXPECT_NE(client.connection().why, "");
    EXPECT_TRUE(client.NewestPose());
  }
  EXPECT_TRUE(Eventually([&] { return settings >= 3; }));
  // Never the same state twice without another reason.
  const std::vector<Connection> seen = connections.all();
  for (std::size_t n = 1; n < seen.size(); ++n) {
    EXPECT_TRUE(seen[n].state != seen[n - 1].state || seen[n].why != seen[n - 1].why);
  }
  EXPECT_EQ(std::count_if(seen.begin(), seen.end(),
                          [](auto& c) { return c.state == ConnectionState::kConnected; }),
            3);
}

TEST_F(SdkClient, ResumesFromItsRevisionAfterAHang) {
  daemon_.Start();
  Client client(Following());
  Viewer viewer;
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1); }));
  const std::size_t first = viewer.received();
  daemon_.Hang();
  ASSERT_TRUE(IsLost(client));
  EXPECT_NE(client.connection().why.find(client.name()), std::string::npos);
  daemon_.Continue();
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  const EditResult edited = client.Apply(Dab(5));
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, edited.volume_revision); }));
  // The same volume of the same daemon: only what changed came.
  EXPECT_EQ(viewer.anew(), 1);
  EXPECT_LT(viewer.received(), first + 40);
  EXPECT_TRUE(viewer.IsTheVolumeOf(daemon_, edited.volume_revision));
}

TEST_F(SdkClient, NoCallbackRunsAfterTheEnd) {
  daemon_.Start();
  int ended_with_poses = 0;
  for (int n = 0; n < 16; ++n) {
    std::atomic<bool> ended{false};
    std::atomic<int> late{0}, poses{0};
    const auto note = [&](const auto&...) { late += ended; };
    ClientOptions options = Following();
    options.poses.rate_hz = 1000.0;
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
  EXPECT_GE(ended_with_poses, 8);
}

TEST_F(SdkClient, CallsFromCallbacksWork) {
  daemon_.Start();
  std::atomic<Client*> self{nullptr};
  std::atomic<int> answers{0};
  ClientOptions options = Options();
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
}

// A call that the end cancels is the callback's to report, and no reason to end the program.
TEST_F(SdkClient, EndsUnderTheCallsOfItsCallbacks) {
  daemon_.Start();
  std::atomic<int> cancelled{0};
  for (int n = 0; n < 30; ++n) {
    std::atomic<Client*> self{nullptr};
    std::atomic<int> calls{0};
    ClientOptions options = Options();
    options.callbacks.on_poses = [&](const PoseBatch&) {
      while (Client* client = self) {
        ++calls;
        try {
          client->GetSettings();
        } catch (const Error&) {
          ++cancelled;
          throw;
        }
      }
    };
    Client client(options);
    self = &client;
    ASSERT_TRUE(Eventually([&] { return calls > 3; }));
  }
  EXPECT_GT(cancelled, 0);
}

TEST(SdkClientOverTcp, ServesManyThreads) {
  const std::string host_port = "127.0.0.1:" + std::to_string(test::FreePort());
  RestartedDaemon daemon({"--volume", "builtin:bumps:32", "--listen", host_port},
                         "[server]\nloopback_role = \"editor\"\n");
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

TEST_F(SdkClient, FollowsEditsAndUndo) {
  daemon_.Start();
  std::atomic<int> notices{0};
  ClientOptions options = Following();
  options.callbacks.on_volume = [&] { ++notices; };
  Client client(options);
  Client editor(Options());
  ASSERT_TRUE(client.WaitUntilConnected(60s) && editor.WaitUntilConnected(60s));
  Viewer viewer;
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, 1); }));
  EXPECT_EQ(viewer.volume().lattice()->Bricks(), 216u);
  EXPECT_TRUE(viewer.volume().X_DI());
  EXPECT_TRUE(client.volume_status().complete);
  EXPECT_EQ(client.volume_status().problem, "");
  EXPECT_GT(client.volume_status().bytes_received, 1000u);
  EXPECT_FALSE(editor.TakeVolumeUpdate());  // it follows no volume
  const std::size_t first = viewer.received();
  const int noticed = notices;

  Edit block;
  block.shape = Block{Vec3i(8, 0, 0), Vec3i(1, 1, 2), {0.25f, 0.5f}};
  block.operation = EditOperation::kSet;
  const EditResult one = editor.Apply(block);
  ASSERT_TRUE(one.changed);
  EXPECT_EQ(one.changed->min, Vec3i(8, 0, 0));
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, one.volume_revision); }));
  EXPECT_GT(notices, noticed);
  EXPECT_EQ(viewer.received(), first + 1);
  EXPECT_EQ(viewer.volume().Value({8, 0, 0}), 0.25f);
  block.shape = Block{Vec3i(0, 0, 0), Vec3i(16, 16, 4096), std::vector<float>(1 << 20)};
  EXPECT_EQ(Refusal([&] { editor.Apply(block); }), ErrorKind::kTooLarge);

  EditResult last;
  for (int n = 0; n < 100; ++n) last = editor.Apply(Dab(n));
  EXPECT_EQ(last.undo_steps, 101u);
  editor.Undo();
  editor.Redo();
  last = editor.Undo();
  EXPECT_EQ(last.redo_steps, 1u);
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, last.volume_revision); }));
  EXPECT_TRUE(viewer.IsTheVolumeOf(daemon_, last.volume_revision));
  last = editor.Revert();
  ASSERT_TRUE(Eventually([&] { return viewer.Take(client, last.volume_revision); }));
  EXPECT_TRUE(viewer.IsTheVolumeOf(daemon_, last.volume_revision));
  EXPECT_EQ(viewer.anew(), 1);
}

// --- Poses and settings, as they are asked for

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

class SdkStreams : public SdkClient {
 protected:
  void SetUp() override { daemon_.Start(); }
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

// --- What is about time

template <typename Work>
double SecondsOf(const Work& work) {
  const auto begin = Clock::now();
  work();
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

class SdkClientTimes : public SdkClient {};

// The end waits for no call and no pause: a call of the same client waits for its whole deadline.
TEST_F(SdkClientTimes, TheEndIsFarSoonerThanACallThatNobodyAnswers) {
  const test::StolenShare stolen;
  daemon_.Start();
  daemon_.Hang();
  auto client = std::make_unique<Client>(Following());
  const double call_s = SecondsOf([&] { EXPECT_THROW(client->GetSettings(), Error); });
  const double end_s = SecondsOf([&] { client.reset(); });
  std::printf("a call %.2f s, the end %.2f s\n", call_s, end_s);
  EXPECT_LT(end_s, 0.2 * call_s);
}

// No attempt is in vain: gRPC's own channels keep failing for a while after the daemon
// is back. Pauses double and are shortened by a half at most, so that the one that runs
// lasts no longer than twice the time without a daemon, and 0.1 s.
TEST_F(SdkClientTimes, IsBackAfterThePauseThatRuns) {
  const test::StolenShare stolen;
  daemon_.Start();
  const Client client(Options());
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  // Poses have come, after which the pauses begin anew.
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  daemon_.Kill();
  ASSERT_TRUE(IsLost(client));
  const double down_s = SecondsOf([&] {
    std::this_thread::sleep_for(1s);
    daemon_.Start();
  });
  const double back_s = SecondsOf([&] { ASSERT_TRUE(client.WaitUntilConnected(60s)); });
  std::printf("down for %.2f s, back after %.2f s\n", down_s, back_s);
  EXPECT_LT(back_s, 2.0 * down_s + 0.4);
}

// At 20 Mbit/s, for all connections together.
TEST(SdkStopTimes, AnUploadAddsNextToNothing) {
  const test::TemporaryFolder folder;
  const std::string config = folder.path() / "palpated.toml", file = folder.path() / "large.nrrd";
  std::ofstream(config) << "[server]\nloopback_role = \"operator\"\n";
  std::ofstream(file) << "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 256 256 320\n"
                      << "encoding: raw\n\n"
                      << std::string(20 << 20, 'a');
  const int port = test::FreePort();
  const test::Daemon daemon(
      test::kPalpated,
      {"builtin:sphere:16", "--listen", "127.0.0.1:" + std::to_string(port), "--config", config});
  const test::Throttle link(port, 20e6 / 8);
  Client client({.address = {.host_port = "127.0.0.1:" + std::to_string(link.port())}});
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  const auto stop_ms = [&client] {
    std::vector<double> taken_ms;
    for (int n = 0; n < 30; ++n) {
      const auto began = Clock::now();
      EXPECT_EQ(client.StopForces().forces.state, ForceState::kStopped);
      taken_ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - began).count());
      std::this_thread::sleep_for(50ms);
    }
    std::sort(taken_ms.begin(), taken_ms.end());
    return taken_ms;
  };
  const std::vector<double> alone_ms = stop_ms();
  std::atomic<bool> ends = false, begun = false;
  auto upload = client.Async([&](Calls& calls) {
    return Refusal([&] {
      calls.UploadVolume(file, {}, [&](const Progress& now) {
        begun = begun || now.fraction > 0.02;
        return !ends;
      });
    });
  });
  ASSERT_TRUE(Eventually([&] { return begun.load(); }));
  const std::vector<double> beside_ms = stop_ms();
  EXPECT_EQ(upload.wait_for(0s), std::future_status::timeout);
  ends = true;
  std::printf("stops: median %.1f ms, worst %.1f; beside an upload %.1f, %.1f\n", alone_ms[15],
              alone_ms.back(), beside_ms[15], beside_ms.back());
  EXPECT_LT(beside_ms[15], alone_ms[15] + 50.0);
  EXPECT_EQ(upload.get(), ErrorKind::kCancelled);
  client.Disconnect();
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
