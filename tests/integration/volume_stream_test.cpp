// Copies of the volume over a real gRPC server on a Unix socket. What such a stream sends is
// volume_feed_test's; many readers, and slow ones, are volume_streams_test's.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <string>
#include <thread>

#include "client/sdk/volume_mirror.h"
#include "client/sdk/volume_reader.h"
#include "common/wire/volume_message.h"
#include "palpate/v1/volume.grpc.pb.h"
#include "tests/support/patience.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::DifferentVoxels;
using testing::EditableSession;

class VolumeStreamTest : public ::testing::Test {
 protected:
  using Requests = std::vector<v1::StreamVolumeRequest>;

  void SetUp() override {
    server_.Reserve();
    data_.Load("builtin:gyroid:64");
    server_.Start();
  }

  // A connection of its own, not one that gRPC shares between channels.
  std::shared_ptr<grpc::Channel> Channel() const {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return grpc::CreateCustomChannel("unix:" + socket_, grpc::InsecureChannelCredentials(),
                                     arguments);
  }
  // How a stream ends on which these are sent.
  grpc::Status StatusAfter(const Requests& requests, bool done) const {
    const auto stub = v1::VolumeService::NewStub(Channel());
    grpc::ClientContext context;
    const auto call = stub->StreamVolume(&context);
    for (const v1::StreamVolumeRequest& request : requests) call->Write(request);
    if (done) call->WritesDone();
    v1::StreamVolumeResponse response;
    while (call->Read(&response)) {
    }
    return call->Finish();
  }

  // Reads until the mirror is complete at the newest revision.
  bool CatchUp(client::VolumeReader& reader, const client::VolumeMirror& mirror) const {
    return test::Eventually([&] {
      reader.Next(10ms);
      return mirror.is_complete() && mirror.resume()->volume_revision == data_.volume()->revision();
    });
  }

  test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock";
  mutable testing::ServedSession served_{socket_};
  EditableSession& data_ = served_.data();
  RpcServer& server_ = served_.server();
  std::mt19937 random_{3};
};

// Each stream has two messages at least: where the volume lies, and that the copy is complete.
TEST_F(VolumeStreamTest, WhoComesBackInTheMidstHasTheVolumeInTheEnd) {
  client::VolumeMirror mirror;
  for (int n = 0; n < 40; ++n) {
    data_.RandomEdit(random_, 20);
    if (n % 10 == 9) data_.Load(n % 20 == 9 ? "builtin:sphere:48" : "builtin:bumps:56");
    client::VolumeReader reader(Channel(), mirror, {.max_unacknowledged = 1u + n % 4});
    for (int messages = 0; messages < 2;) {
      messages += reader.Next(10ms) != client::VolumeReader::Event::kTimeout;
    }
  }
  client::VolumeReader reader(Channel(), mirror);
  ASSERT_TRUE(CatchUp(reader, mirror));
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
}

TEST_F(VolumeStreamTest, BadRequestsEndTheStreamWithAReason) {
  v1::StreamVolumeRequest good, acknowledge, wide;
  good.mutable_start();
  acknowledge.mutable_acknowledgement()->set_message_number(1);
  wide.mutable_start()->set_max_unacknowledged(65);
  for (const Requests& bad : {Requests{}, {acknowledge}, {{}}, {wide}, {good, good}, {good, {}}}) {
    const grpc::Status status = StatusAfter(bad, bad.empty());
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << bad.size();
    EXPECT_FALSE(status.error_message().empty());
  }
  // And a good one ends in order when the client has said all.
  EXPECT_TRUE(StatusAfter({good}, true).ok());
}

TEST_F(VolumeStreamTest, ARevisionThatTheDaemonDoesNotHaveIsMendedByAFreshCopy) {
  client::VolumeMirror mirror;
  {
    client::VolumeReader reader(Channel(), mirror);
    ASSERT_TRUE(CatchUp(reader, mirror));
  }
  // As if the daemon had gone back.
  VolumeComplete future{*mirror.resume(), data_.volume()->bricks().content_hash(), {}};
  auto background = BackgroundHashOf(*data_.volume());
  while (!background->Advance(1000)) {
  }
  future.background_hash = background->hash();
  future.revision.volume_revision += 5;
  mirror.Apply(future);
  mirror.TakeChanges();
  client::VolumeReader reader(Channel(), mirror);
  ASSERT_TRUE(CatchUp(reader, mirror));
  EXPECT_TRUE(mirror.TakeChanges().all);
  EXPECT_EQ(reader.losses(), 1u);
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
}

TEST_F(VolumeStreamTest, StoppingTheServerEndsStreamsThatReadAndThatDoNot) {
  const auto stub = v1::VolumeService::NewStub(Channel());
  v1::StreamVolumeRequest start;
  start.mutable_start();
  grpc::ClientContext idle_context;
  const auto idle = stub->StreamVolume(&idle_context);
  idle->Write(start);
  client::VolumeMirror mirror;
  client::VolumeReader reader(Channel(), mirror);
  ASSERT_TRUE(CatchUp(reader, mirror));
  std::thread stop([&] { server_.Stop(); });
  while (reader.Next(100ms) != client::VolumeReader::Event::kLost) {
  }
  EXPECT_EQ(reader.last_loss()->kind(), ErrorKind::kUnavailable);
  stop.join();
  v1::StreamVolumeResponse response;
  while (idle->Read(&response)) {
  }
  EXPECT_EQ(idle->Finish().error_code(), grpc::StatusCode::UNAVAILABLE);
  // What was copied stays, and the reader keeps trying.
  EXPECT_EQ(DifferentVoxels(mirror, *data_.volume()), 0u);
  while (reader.losses_in_a_row() < 3) reader.Next(100ms);
}

}  // namespace
}  // namespace palpate
