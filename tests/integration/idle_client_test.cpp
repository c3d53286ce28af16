// Clients that begin something over a real gRPC server, and then neither send nor read.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "palpate/v1/volume.grpc.pb.h"
#include "tests/support/patience.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

class IdleClientTest : public ::testing::Test {
 protected:
  void SetUp() override {
    served_.server().Reserve();
    served_.data().Load("builtin:sphere:16");
    served_.server().Start();
  }

  std::uint64_t ClaimedBytes() { return served_.data().session().loader().budget->held_bytes(); }

  test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock";
  testing::ServedSession served_{socket_, {.send_patience = std::chrono::milliseconds(200)}};
};

// Its claim on the memory budget would keep others from loading.
class IdleUpload : public IdleClientTest, public ::testing::WithParamInterface<bool> {};

TEST_P(IdleUpload, EndsAndGivesItsClaimBack) {
  const bool drips = GetParam();
  const std::uint64_t before = ClaimedBytes();
  const auto stub = v1::VolumeService::NewStub(
      grpc::CreateChannel("unix:" + socket_, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  // Long after the next look at running calls, which is 2 s away at most.
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  v1::UploadVolumeResponse response;
  const auto call = stub->UploadVolume(&context, &response);
  v1::UploadVolumeRequest message;
  message.mutable_start()->set_name("head.nrrd");
  message.mutable_start()->set_size_bytes(1 << 20);
  ASSERT_TRUE(call->Write(message));
  ASSERT_TRUE(test::Eventually([&] { return ClaimedBytes() > before; }));
  message.set_data("x");
  while (drips && call->Write(message)) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(call->Finish().error_code(), grpc::StatusCode::CANCELLED);
  EXPECT_TRUE(test::Eventually([&] { return ClaimedBytes() == before; }));
}

INSTANTIATE_TEST_SUITE_P(StandsStillOrDrips, IdleUpload, ::testing::Bool());

}  // namespace
}  // namespace palpate
