// Copies of the volume over a real gRPC server on a Unix socket, while it is edited. What such a
// stream sends is volume_feed_test's, and slow readers are volume_streams_test's.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>
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

TEST_F(VolumeStreamTest, SlowFastAndReconnectingViewersHaveTheVolumeInTheEnd) {
  std::atomic<bool> done{false};
  std::atomic<int> equal{0}, reconnects{0};
  std::vector<std::thread> viewers;
  for (int n = 0; n < 4; ++n) {
    viewers.emplace_back([&, n] {
      const auto channel = Channel();
      const client::VolumeReaderOptions options{.max_unacknowledged = n == 0 ? 64u : 1u + n};
      client::VolumeMirror mirror;
      auto reader = std::make_unique<client::VolumeReader>(channel, mirror, options);
      for (int messages = 0; !done;) {
        messages += reader->Next(10ms) != client::VolumeReader::Event::kTimeout;
        if (n == 1) std::this_thread::sleep_for(5ms);
        if (n != 2 || messages < 7) continue;
        // In the midst of a revision, as a rule.
        messages = 0;
        reader = std::make_unique<client::VolumeReader>(channel, mirror, options);
        ++reconnects;
      }
      if (CatchUp(*reader, mirror)) equal += DifferentVoxels(mirror, *data_.volume()) == 0;
    });
  }
  for (int n = 0; n < 600 || reconnects < 10; ++n) {
    data_.RandomEdit(random_, 20);
    if (n % 200 == 199) data_.Load(n % 400 < 200 ? "builtin:sphere:48" : "builtin:bumps:56");
    if (n % 3 == 0) {
      data_.session().Move([n](const VolumeState& state) {
        Registration moved = state.registration;
        moved.X_DW.translation.x() = n % 100;
        return moved;
      });
    }
    std::this_thread::sleep_for(1ms);
  }
  done = true;
  for (std::thread& viewer : viewers) viewer.join();
  EXPECT_EQ(equal, 4);
}

TEST_F(VolumeStreamTest, BadRequestsEndTheStreamWithAReason) {
  v1::StreamVolumeRequest good, acknowledge, wide, yet_to_come;
  good.mutable_start();
  acknowledge.mutable_acknowledgement()->set_message_number(1);
  wide.mutable_start()->set_max_unacknowledged(65);
  client::VolumeMirror mirror;
  {
    client::VolumeReader reader(Channel(), mirror);
    ASSERT_TRUE(CatchUp(reader, mirror));
  }
  VolumeRevision future = *mirror.resume();
  ++future.volume_revision;
  *yet_to_come.mutable_start()->mutable_resume_from() = ToProto(future);
  for (const Requests& bad :
       {Requests{}, {acknowledge}, {{}}, {wide}, {yet_to_come}, {good, good}, {good, {}}}) {
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
  VolumeComplete future{*mirror.resume(), data_.volume()->bricks().content_hash()};
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
