// Clients that begin something over a real gRPC server, and then neither send nor read.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

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
TEST_F(IdleClientTest, AnUploadThatStandsStillEndsAndGivesItsClaimBack) {
  const std::uint64_t before = ClaimedBytes();
  const auto stub = v1::VolumeService::NewStub(
      grpc::CreateChannel("unix:" + socket_, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  // Long after the next look at running calls, which is 2 s away at most.
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  v1::UploadVolumeResponse response;
  const auto call = stub->UploadVolume(&context, &response);
  v1::UploadVolumeRequest start;
  start.mutable_start()->set_name("head.nrrd");
  start.mutable_start()->set_size_bytes(1 << 20);
  ASSERT_TRUE(call->Write(start));
  ASSERT_TRUE(test::Eventually([&] { return ClaimedBytes() > before; }));
  EXPECT_EQ(call->Finish().error_code(), grpc::StatusCode::CANCELLED);
  EXPECT_TRUE(test::Eventually([&] { return ClaimedBytes() == before; }));
}

}  // namespace
}  // namespace palpate
