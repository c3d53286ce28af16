// What waits while the memory of a large volume is freed.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "palpate/v1/device.grpc.pb.h"
#include "server/volume/snapshot/brick_memory.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate::load {
namespace {

using Clock = std::chrono::steady_clock;

// 8 GiB of floats.
const Vec3i kLarge(2048, 1024, 1024);
constexpr std::uint64_t kFreed = std::uint64_t{64} << 20;

class ReleaseTest : public ::testing::Test {
 protected:
  void SetUp() override {
    served_.server().Reserve();
    served_.data().Load("builtin:sphere:32");
    served_.data().Start();
    served_.server().Start();
  }

  // Milliseconds until the forces are known to be off.
  double StopForces() {
    const auto begun = Clock::now();
    grpc::ClientContext context;
    v1::StopForcesResponse response;
    EXPECT_TRUE(stub_->StopForces(&context, {}, &response).ok());
    return std::chrono::duration<double, std::milli>(Clock::now() - begun).count();
  }

  const test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock";
  testing::ServedSession served_{socket_};
  const std::unique_ptr<v1::DeviceService::Stub> stub_ = v1::DeviceService::NewStub(
      grpc::CreateChannel("unix:" + socket_, grpc::InsecureChannelCredentials()));
};

TEST_F(ReleaseTest, AnEmergencyStopIsAnsweredWhileGigabytesAreFreed) {
  Session& session = served_.data().session();
  const std::uint64_t small_bytes = LiveBrickBytes();
  {
    VolumeMetadata metadata;
    metadata.size = kLarge;
    metadata.source = "large";
    session.PublishVolume({}, metadata, BrickDirectory(kLarge, [](const Vec3i&) {
                            return testing::FilledLeaf(0.5f);
                          }));
  }
  std::vector<double> quiet, beside;
  for (int n = 0; n < 300; ++n) quiet.push_back(StopForces());
  served_.data().Load("builtin:sphere:32");
  while (LiveBrickBytes() > small_bytes + kFreed) beside.push_back(StopForces());
  ASSERT_GT(beside.size(), 20u);
  const auto middle = [](std::vector<double>& all) {
    std::nth_element(all.begin(), all.begin() + std::ssize(all) / 2, all.end());
    return all[all.size() / 2];
  };
  const double worst_quiet = *std::max_element(quiet.begin(), quiet.end());
  const double worst = *std::max_element(beside.begin(), beside.end());
  std::printf("%zu stops while 8 GiB are freed: median %.2f ms, worst %.1f; quiet: %.2f and %.1f\n",
              beside.size(), middle(beside), worst, middle(quiet), worst_quiet);
  EXPECT_LE(middle(beside), 10 * middle(quiet));
  EXPECT_LE(worst, 10 * worst_quiet);
}

}  // namespace
}  // namespace palpate::load
