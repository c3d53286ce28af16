// The operator's hand on the forces of a real daemon, whose simulated hand explores:
// over real gRPC and by the client.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

constexpr double kSlewNPerTick = 0.2;
constexpr int kRampOutTicks = 17;  // 3.3 N by the slew limit
constexpr double kFeltN = 0.3;

double ForceN(const v1::PoseSample& sample) {
  const v1::Vector3& f = sample.force_n();
  return std::hypot(f.x(), f.y(), f.z());
}

// What a command answered.
struct Answer {
  grpc::Status status;
  v1::ForceStatus forces;
  std::uint64_t tick = 0;
};

class DeviceTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:48"});
  }
  static void TearDownTestSuite() { daemon_.reset(); }
  void SetUp() override { ASSERT_TRUE(Enable().status.ok()); }

  static Answer Enable(const std::string& name = "") {
    v1::EnableForcesRequest request;
    request.set_device(name);
    v1::EnableForcesResponse response;
    grpc::ClientContext context;
    const grpc::Status status = daemon_->device->EnableForces(&context, request, &response);
    return {status, response.forces(), response.applied_tick()};
  }
  static Answer Disable() {
    v1::DisableForcesResponse response;
    grpc::ClientContext context;
    const grpc::Status status = daemon_->device->DisableForces(&context, {}, &response);
    return {status, response.forces(), response.applied_tick()};
  }
  static Answer Stop() {
    v1::StopForcesResponse response;
    grpc::ClientContext context;
    const grpc::Status status = daemon_->device->StopForces(&context, {}, &response);
    return {status, response.forces(), response.applied_tick()};
  }
  static v1::GetDeviceResponse Device() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    EXPECT_TRUE(daemon_->device->GetDevice(&context, {}, &response).ok());
    return response;
  }
  static ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  // Until the hand feels something; false when it does not within half a minute.
  static bool WaitForForce() {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
    const auto stream = daemon_->poses->StreamPoses(&context);
    v1::StreamPosesRequest request;
    request.mutable_start()->set_rate_hz(1000);
    request.mutable_start()->set_max_unacknowledged(4);
    stream->Write(request);
    bool felt = false;
    for (v1::StreamPosesResponse message; !felt && stream->Read(&message);) {
      felt = ForceN(message.samples(0)) > kFeltN;
      request.mutable_acknowledgement()->set_message_number(message.message_number());
      stream->Write(request);
    }
    context.TryCancel();
    stream->Finish();
    return felt;
  }

  // Samples of the ticks from `begin` to before `end`.
  static std::vector<v1::PoseSample> Between(const std::vector<v1::PoseSample>& samples,
                                             std::uint64_t begin, std::uint64_t end) {
    std::vector<v1::PoseSample> found;
    for (const v1::PoseSample& sample : samples) {
      if (sample.tick() >= begin && sample.tick() < end) found.push_back(sample);
    }
    return found;
  }

  static std::unique_ptr<Daemon> daemon_;
};
std::unique_ptr<Daemon> DeviceTest::daemon_;

TEST_F(DeviceTest, StopIsZeroForceInItsTickAndStays) {
  constexpr int kRounds = 5;
  PoseCollector collector(*daemon_);
  std::vector<Answer> stops, enables;
  for (int round = 0; round < kRounds; ++round) {
    ASSERT_TRUE(WaitForForce());
    stops.push_back(Stop());
    ASSERT_TRUE(stops.back().status.ok());
    EXPECT_EQ(stops.back().forces.state(), v1::FORCE_STATE_STOPPED);
    EXPECT_EQ(stops.back().forces.reason(), v1::FORCE_REASON_STOP_CALL);
    ASSERT_TRUE(daemon_->WaitForTicks(300));
    enables.push_back(Enable());
    ASSERT_TRUE(enables.back().status.ok());
    EXPECT_EQ(enables.back().forces.state(), v1::FORCE_STATE_ON);
  }
  ASSERT_TRUE(WaitForForce());
  const std::vector<v1::PoseSample>& samples = collector.Stop();
  int in_contact = 0;
  for (int round = 0; round < kRounds; ++round) {
    const auto stopped = Between(samples, stops[round].tick, enables[round].tick);
    EXPECT_GT(stopped.size(), 100u) << kBusyMachine;
    for (const v1::PoseSample& sample : stopped) {
      ASSERT_EQ(ForceN(sample), 0.0) << sample.tick() - stops[round].tick;
      ASSERT_EQ(sample.forces().state(), v1::FORCE_STATE_STOPPED);
    }
    for (const v1::PoseSample& before :
         Between(samples, stops[round].tick - 1, stops[round].tick)) {
      EXPECT_EQ(before.forces().state(), v1::FORCE_STATE_ON);
      in_contact += ForceN(before) > kFeltN;
    }
    const std::uint64_t next = round + 1 < kRounds ? stops[round + 1].tick : UINT64_MAX;
    for (const v1::PoseSample& after : Between(samples, enables[round].tick, next)) {
      ASSERT_EQ(after.forces().state(), v1::FORCE_STATE_ON);
    }
  }
  EXPECT_GT(in_contact, 0);
  std::printf("%d of %d stops while a force was felt\n", in_contact, kRounds);
}

TEST_F(DeviceTest, DisableRampsOutByTheSlewLimit) {
  constexpr int kRounds = 5;
  PoseCollector collector(*daemon_);
  std::vector<Answer> disables, enables;
  for (int round = 0; round < kRounds; ++round) {
    ASSERT_TRUE(WaitForForce());
    disables.push_back(Disable());
    ASSERT_TRUE(disables.back().status.ok());
    EXPECT_EQ(disables.back().forces.state(), v1::FORCE_STATE_OFF);
    EXPECT_EQ(disables.back().forces.reason(), v1::FORCE_REASON_OPERATOR);
    ASSERT_TRUE(daemon_->WaitForTicks(200));
    enables.push_back(Enable());
  }
  const std::vector<v1::PoseSample>& samples = collector.Stop();
  int ramps = 0;
  for (int round = 0; round < kRounds; ++round) {
    const std::uint64_t off_tick = disables[round].tick;
    const auto off = Between(samples, off_tick - 1, enables[round].tick);
    ASSERT_GT(off.size(), 50u) << kBusyMachine;
    for (std::size_t n = 1; n < off.size(); ++n) {
      EXPECT_EQ(off[n].forces().state(), v1::FORCE_STATE_OFF);
      if (off[n].tick() >= off_tick + kRampOutTicks) {
        ASSERT_EQ(ForceN(off[n]), 0.0);
      }
      if (off[n].tick() != off[n - 1].tick() + 1) continue;
      const double fall_n = ForceN(off[n - 1]) - ForceN(off[n]);
      EXPECT_GE(fall_n, -1e-12);
      EXPECT_LE(fall_n, kSlewNPerTick + 1e-9);
      ramps += ForceN(off[n]) > 0.0;
    }
  }
  EXPECT_GT(ramps, 0);
}

TEST_F(DeviceTest, NamesAreChecked) {
  for (const char* name : {"falcon", "Simulated", "simulated ", "omni-usb"}) {
    const Answer refused = Enable(name);
    EXPECT_EQ(refused.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << name;
    EXPECT_NE(refused.status.error_message().find("`simulated`"), std::string::npos);
  }
  EXPECT_TRUE(Enable("simulated").status.ok());
  // A refusal does not end a stop.
  ASSERT_TRUE(Stop().status.ok());
  EXPECT_FALSE(Enable("falcon").status.ok());
  EXPECT_EQ(Device().forces().state(), v1::FORCE_STATE_STOPPED);
}

TEST_F(DeviceTest, EnablingTwiceTellsSinceWhen) {
  const Answer first = Enable();
  const Answer second = Enable();
  EXPECT_EQ(first.tick, second.tick);
  const Answer stop = Stop();
  EXPECT_GT(stop.tick, second.tick);
  EXPECT_EQ(Stop().tick, stop.tick);
}

TEST_F(DeviceTest, StopsWhileAVolumeLoads) {
  std::atomic<bool> loading{true};
  std::thread loader([&] {
    grpc::ClientContext context;
    v1::LoadVolumeRequest request;
    request.set_source("builtin:gyroid:320");
    const auto reader = daemon_->volume->LoadVolume(&context, request);
    for (v1::LoadVolumeResponse event; reader->Read(&event);) {
    }
    EXPECT_TRUE(reader->Finish().ok());
    loading = false;
  });
  std::vector<double> seconds;
  int failed = 0;
  while (loading) {
    const auto begin = Clock::now();
    failed += !Stop().status.ok();
    seconds.push_back(std::chrono::duration<double>(Clock::now() - begin).count());
    failed += !Enable().status.ok();
  }
  loader.join();
  std::sort(seconds.begin(), seconds.end());
  EXPECT_EQ(failed, 0);
  ASSERT_GT(seconds.size(), 10u);
  EXPECT_LT(seconds[seconds.size() / 2], 0.2) << kBusyMachine;
  std::printf("%zu stops during a load, %.1f ms in the middle, %.1f ms at most\n", seconds.size(),
              1e3 * seconds[seconds.size() / 2], 1e3 * seconds.back());
}

TEST_F(DeviceTest, NoForceAfterTheLastStopOfManyClients) {
  constexpr int kClients = 8;
  constexpr int kCalls = 40;
  PoseCollector collector(*daemon_);
  ASSERT_TRUE(WaitForForce());
  std::atomic<int> wrong{0};
  std::vector<std::thread> clients;
  for (int client = 0; client < kClients; ++client) {
    clients.emplace_back([&, client] {
      std::mt19937 random(client);
      for (int n = 0; n < kCalls; ++n) {
        const std::uint32_t draw = random() % 4;
        const Answer answer = draw < 2 ? Enable("simulated") : draw == 2 ? Disable() : Stop();
        const grpc::StatusCode code = answer.status.error_code();
        // An enable may lose against another client's stop.
        const bool lost = draw < 2 && code == grpc::StatusCode::FAILED_PRECONDITION;
        wrong += code != grpc::StatusCode::OK && !lost;
      }
      // Whichever comes last is a stop.
      wrong += !Stop().status.ok();
    });
  }
  for (std::thread& client : clients) client.join();
  const v1::GetDeviceResponse last = Device();
  std::this_thread::sleep_for(std::chrono::seconds(2));
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(last.forces().state(), v1::FORCE_STATE_STOPPED);
  EXPECT_EQ(Device().forces().state(), v1::FORCE_STATE_STOPPED);
  const std::vector<v1::PoseSample>& samples = collector.Stop();
  const auto after = Between(samples, last.servo().ticks(), UINT64_MAX);
  EXPECT_GT(after.size(), 500u) << kBusyMachine;
  for (const v1::PoseSample& sample : after) ASSERT_EQ(ForceN(sample), 0.0);
  std::map<int, int> ticks_of_state;
  for (const v1::PoseSample& sample : samples) {
    ++ticks_of_state[sample.forces().state()];
    if (sample.forces().state() == v1::FORCE_STATE_STOPPED) {
      ASSERT_EQ(ForceN(sample), 0.0) << sample.tick();
    }
  }
  // The attack was one: every state came.
  for (const int state : {v1::FORCE_STATE_ON, v1::FORCE_STATE_OFF, v1::FORCE_STATE_STOPPED}) {
    EXPECT_GT(ticks_of_state[state], 0) << state;
  }
}

TEST_F(DeviceTest, TheSimulatedDeviceNeedsNoCalibration) {
  grpc::ClientContext context;
  v1::CalibrateDeviceResponse response;
  const grpc::Status status = daemon_->device->CalibrateDevice(&context, {}, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_NE(status.error_message().find("no calibration"), std::string::npos);
}

TEST_F(DeviceTest, GetDeviceTellsHealthAndForces) {
  const v1::GetDeviceResponse response = Device();
  EXPECT_EQ(response.health().connection(), v1::DEVICE_CONNECTION_STREAMING);
  EXPECT_TRUE(response.health().calibrated());
  EXPECT_EQ(response.health().problem(), "");
  EXPECT_EQ(response.forces().state(), v1::FORCE_STATE_ON);
  EXPECT_EQ(response.forces().reason(), v1::FORCE_REASON_NONE);
  EXPECT_EQ(response.forces().limit_n(), 3.3);
}

TEST_F(DeviceTest, TheClientEnablesDisablesAndStops) {
  ProcessResult result = Run({"device", "stop"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("forces    stopped: emergency stop"), std::string::npos);
  const ProcessResult watched = Run({"watch", "--seconds", "1.5"});
  EXPECT_NE(watched.output.find("forces stopped (stop call)"), std::string::npos) << watched.output;
  const json sample = json::parse(Run({"watch", "--json", "--count", "1"}).output);
  EXPECT_EQ(sample["forces"]["state"], "stopped");
  EXPECT_EQ(sample["forces"]["reason"], "stop_call");
  EXPECT_NE(Run({"info"}).output.find("emergency stop"), std::string::npos);
  EXPECT_EQ(json::parse(Run({"info", "--json"}).output)["forces"]["state"], "stopped");
  EXPECT_EQ(json::parse(Run({"device", "enable", "--json"}).output)["state"], "on");
  EXPECT_EQ(json::parse(Run({"device", "disable", "--json"}).output)["state"], "off");
  result = Run({"device", "enable", "falcon"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_NE(result.error.find("palpate device enable simulated"), std::string::npos);
  EXPECT_EQ(Run({"device", "enable", "simulated"}).exit_code, 0);
  result = Run({"device", "calibrate"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_EQ(std::count(result.error.begin(), result.error.end(), '\n'), 1) << result.error;
}

TEST_F(DeviceTest, TheClientListsDescribesAndTests) {
  const json list = json::parse(Run({"device", "list", "--json"}).output);
  ASSERT_GE(list["devices"].size(), 1u);
  int in_use = 0;
  for (const json& device : list["devices"]) {
    in_use += device["in_use"] == true;
    EXPECT_EQ(device["in_use"], device["kind"] == "simulated");
    EXPECT_EQ(device["usable"], device["problem"] == "");
  }
  EXPECT_EQ(in_use, 1);
  EXPECT_NE(Run({"device", "list"}).output.find("in use"), std::string::npos);
  EXPECT_NE(Run({"device", "info"}).output.find("simulated: there is no hardware to verify"),
            std::string::npos);
  ProcessResult result = Run({"device", "test", "--seconds", "1"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("verdict   passed"), std::string::npos) << result.output;
  const json figures = json::parse(Run({"device", "test", "--json", "--seconds", "1"}).output);
  EXPECT_GT(figures["samples"], 300) << kBusyMachine;
  EXPECT_EQ(figures["passed"], true) << (figures["samples"] > 300 ? "" : kBusyMachine);
  EXPECT_EQ(figures["fault_ticks"], 0);
}

}  // namespace
}  // namespace palpate::test
