// Poses by the client library: newest, in batches, and with a slow reader.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <mutex>

#include "client/sdk/client.h"
#include "palpate/v1/pose.grpc.pb.h"
#include "tests/support/excuse.h"
#include "tests/support/patience.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;
using test::RestartedDaemon;
using Clock = std::chrono::steady_clock;

double AgeMs(const Pose& pose) {
  const std::chrono::nanoseconds now = Clock::now().time_since_epoch();
  return static_cast<double>(now.count() - pose.time_ns) * 1e-6;
}

class SdkPoses : public ::testing::Test {
 protected:
  void SetUp() override { daemon_.Start(); }

  ClientOptions Options(double rate_hz) const {
    return {.address = {.socket_path = daemon_.socket()}, .poses = {.rate_hz = rate_hz}};
  }

  RestartedDaemon daemon_;
};

TEST_F(SdkPoses, TheNewestAdvances) {
  Client client(Options(60));
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  EXPECT_TRUE(client.shares_clock());
  std::uint64_t last = 0;
  int advances = 0;
  std::vector<double> ages_ms;
  for (int n = 0; n < 1000; ++n) {
    const Pose pose = *client.NewestPose();
    ASSERT_GE(pose.tick, last);
    advances += pose.tick > last;
    last = pose.tick;
    ages_ms.push_back(AgeMs(pose));
    std::this_thread::sleep_for(2ms);
  }
  EXPECT_GT(advances, 60) << test::kBusyMachine;  // of 120
  std::sort(ages_ms.begin(), ages_ms.end());
  EXPECT_LT(ages_ms[ages_ms.size() / 2], 40.0) << test::kBusyMachine;
  EXPECT_NEAR(client.NewestPose()->stylus_orientation.norm(), 1.0, 1e-6);
  EXPECT_EQ(client.NewestPose()->forces.state, ForceState::kOn);
}

// In loop time: ticks, with those that the loop missed.
std::uint64_t Step(const Pose& from, const Pose& to) {
  return to.tick + to.missed_ticks - from.tick - from.missed_ticks;
}

struct Heard {
  std::mutex mutex;
  std::vector<Pose> poses;
  std::vector<std::size_t> batches;
  std::uint64_t dropped = 0;

  std::function<void(const PoseBatch&)> Callback() {
    return [this](const PoseBatch& batch) {
      const std::lock_guard lock(mutex);
      poses.insert(poses.end(), batch.poses.begin(), batch.poses.end());
      batches.push_back(batch.poses.size());
      dropped = batch.dropped;
    };
  }
  std::size_t Count() {
    const std::lock_guard lock(mutex);
    return poses.size();
  }
  // From each to the next.
  std::vector<std::uint64_t> Steps() {
    const std::lock_guard lock(mutex);
    std::vector<std::uint64_t> steps;
    for (std::size_t n = 1; n < poses.size(); ++n) steps.push_back(Step(poses[n - 1], poses[n]));
    return steps;
  }
};

// Gaps in loop time, beside the ticks that the loop itself missed.
std::size_t Gaps(const std::vector<Pose>& poses, std::uint64_t step) {
  std::size_t gaps = 0;
  for (std::size_t n = 1; n < poses.size(); ++n) {
    const std::uint64_t missed = poses[n].missed_ticks - poses[n - 1].missed_ticks;
    gaps += Step(poses[n - 1], poses[n]) > step + missed;
  }
  return gaps;
}

// The same stream without the library. The daemon holds one message back, so that what
// it is late for is lost to every stream alike: the machine's share of what is lost.
class PlainStream {
 public:
  PlainStream(const std::string& socket, double rate_hz, std::uint32_t batch)
      : stub_(v1::PoseService::NewStub(Channel(socket))), stream_(stub_->StreamPoses(&context_)) {
    v1::StreamPosesRequest start;
    start.mutable_start()->set_rate_hz(rate_hz);
    start.mutable_start()->set_batch(batch);
    start.mutable_start()->set_max_unacknowledged(16);
    stream_->Write(start);
    thread_ = std::thread([this] { Read(); });
  }
  // Samples that it lost.
  std::uint64_t Stop() {
    context_.TryCancel();
    thread_.join();
    stream_->Finish();
    return dropped_;
  }

 private:
  static std::shared_ptr<grpc::Channel> Channel(const std::string& socket) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return grpc::CreateCustomChannel("unix:" + socket, grpc::InsecureChannelCredentials(),
                                     arguments);
  }
  void Read() {
    v1::StreamPosesResponse message;
    while (stream_->Read(&message)) {
      dropped_ = message.dropped_samples();
      v1::StreamPosesRequest taken;
      taken.mutable_acknowledgement()->set_message_number(message.message_number());
      stream_->Write(taken);
    }
  }

  grpc::ClientContext context_;
  std::unique_ptr<v1::PoseService::Stub> stub_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::StreamPosesRequest, v1::StreamPosesResponse>>
      stream_;
  std::uint64_t dropped_ = 0;
  std::thread thread_;
};

TEST_F(SdkPoses, AFastCallbackLosesNothing) {
  struct Case {
    double rate_hz;
    std::uint64_t step;
    std::size_t batch;
  };
  for (const auto& [rate_hz, step, batch] : {Case{60, 17, 1}, Case{1000, 1, 10}}) {
    Heard heard;
    ClientOptions options = Options(rate_hz);
    options.callbacks.on_poses = heard.Callback();
    auto client = std::make_unique<Client>(options);
    PlainStream plain(daemon_.socket(), rate_hz, static_cast<std::uint32_t>(batch));
    ASSERT_TRUE(client->WaitUntilConnected(60s));
    std::this_thread::sleep_for(5s);
    client.reset();
    const std::uint64_t unavoidable = plain.Stop();
    std::printf("%.0f Hz: %zu poses, %llu dropped (without the library %llu), %zu gaps\n", rate_hz,
                heard.poses.size(), static_cast<unsigned long long>(heard.dropped),
                static_cast<unsigned long long>(unavoidable), Gaps(heard.poses, step));
    EXPECT_GT(heard.poses.size() + heard.dropped, rate_hz * 5 * 0.7) << test::kBusyMachine;
    const auto not_full = std::count_if(heard.batches.begin(), heard.batches.end(),
                                        [batch = batch](std::size_t n) { return n != batch; });
    EXPECT_EQ(not_full, 0) << "of " << heard.batches.size() << test::kBusyMachine;
    EXPECT_TRUE(std::is_sorted(heard.poses.begin(), heard.poses.end(),
                               [](const Pose& a, const Pose& b) { return a.tick < b.tick; }));
    // None that a plain stream does not lose too; two streams are not in step.
    EXPECT_LE(heard.dropped, 2 * unavoidable + 2 * batch) << test::kBusyMachine;
    EXPECT_LE(Gaps(heard.poses, step), heard.dropped);
  }
}

// Ages of the newest pose at each call, for callbacks that take this long.
struct Slow {
  std::vector<double> ages_ms;
  std::uint64_t seen = 0;
  std::uint64_t dropped = 0;

  double Median(std::size_t begin, std::size_t end) const {
    std::vector<double> part(ages_ms.begin() + begin, ages_ms.begin() + end);
    std::nth_element(part.begin(), part.begin() + part.size() / 2, part.end());
    return part[part.size() / 2];
  }
};

TEST_F(SdkPoses, ASlowCallbackSeesFreshPoses) {
  for (const auto takes : {100ms, 500ms}) {
    Slow slow;
    ClientOptions options = Options(1000);
    options.callbacks.on_poses = [&](const PoseBatch& batch) {
      slow.ages_ms.push_back(AgeMs(batch.poses.back()));
      slow.seen += batch.poses.size();
      slow.dropped = batch.dropped;
      std::this_thread::sleep_for(takes);
    };
    auto client = std::make_unique<Client>(options);
    ASSERT_TRUE(client->WaitUntilConnected(60s));
    std::this_thread::sleep_for(8s);
    client.reset();
    const std::size_t count = slow.ages_ms.size();
    ASSERT_GT(count, 9u) << test::kBusyMachine;
    const double middle_ms = slow.Median(count / 3, 2 * count / 3);
    const double end_ms = slow.Median(2 * count / 3, count);
    std::printf("%d ms each: age %.0f ms in the middle, %.0f ms at the end, %llu seen, %llu lost\n",
                static_cast<int>(takes.count()), middle_ms, end_ms,
                static_cast<unsigned long long>(slow.seen),
                static_cast<unsigned long long>(slow.dropped));
    // Well below the time of a single callback, and no older with time.
    EXPECT_LT(middle_ms, 80.0) << test::kBusyMachine;
    EXPECT_LT(end_ms, 80.0) << test::kBusyMachine;
    if (takes == 500ms) {
      EXPECT_GT(slow.dropped, 2000u) << test::kBusyMachine;
    }
  }
}

TEST_F(SdkPoses, TheRateChangesWhileItRuns) {
  Heard heard;
  ClientOptions options = Options(20);
  options.callbacks.on_poses = heard.Callback();
  Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s));
  ASSERT_TRUE(Eventually([&] { return heard.Count() > 20; }));
  client.SetPoseRate({.rate_hz = 1000});
  ASSERT_TRUE(Eventually([&] { return heard.Count() > 1000; }));
  const std::vector<std::uint64_t> steps = heard.Steps();
  // One of each 50 ms of loop time. A tick that the loop missed makes a sample late, and the
  // next step shorter, but never a second sample of the same 50 ms.
  std::uint64_t since_first = 0;
  for (std::uint64_t n = 0; n < 19; ++n) {
    since_first += steps[n];
    EXPECT_GT(since_first, 50 * n) << "pose " << n + 1;
  }
  EXPECT_GT(std::count(steps.begin(), steps.end(), 1u), 500) << test::kBusyMachine;
  EXPECT_THROW(client.SetPoseRate({.rate_hz = 5}), Error);
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
}

}  // namespace
}  // namespace palpate::client
