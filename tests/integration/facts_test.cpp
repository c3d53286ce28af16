// The stream of facts over a real gRPC server, whose session the test changes.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/client.h"
#include "palpate/v1/facts.grpc.pb.h"
#include "tests/support/patience.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::Eventually;

class FactsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    served_.server().Reserve();
    served_.data().Load("builtin:sphere:16");
    served_.data().Start();
    served_.server().Start();
  }

  void SetStiffness(double stiffness_n_per_mm) {
    served_.data().session().Update(
        {.numbers = {{&HapticSettings::stiffness_n_per_mm, stiffness_n_per_mm}}});
  }
  client::ClientOptions Options() const { return {.address = {.socket_path = socket_}}; }

  test::TemporaryFolder folder_;
  const std::string socket_ = folder_.path() / "palpated.sock";
  // Twice as many streams are fewer than a connection may have: the others would wait.
  static constexpr int kStreams = 32;
  testing::ServedSession served_{socket_, {.pose_streams = kStreams}};
};

TEST_F(FactsTest, ALibraryHasAllOfNowAndThenWhatChanges) {
  client::Client client(Options());
  const auto facts = [&] { return client.NewestFacts(); };
  ASSERT_TRUE(Eventually([&] { return facts()->volume && facts()->placement; }));
  EXPECT_EQ(*facts()->volume, client.GetVolume());
  EXPECT_EQ(facts()->recording, client.GetRecording());
  EXPECT_FALSE(facts()->series);
  const client::DaemonInfo daemon = client.GetDevice();
  ASSERT_EQ(facts()->hands->hands.size(), 1U);
  EXPECT_EQ(facts()->hands->hands[0].device, daemon.device);
  EXPECT_EQ(facts()->hands->servo.version, daemon.servo.version);
  EXPECT_EQ(facts()->caller, daemon.caller);
  ASSERT_EQ(facts()->activity->callers.size(), 1U);
  EXPECT_TRUE(facts()->activity->callers[0].is_you);
  SetStiffness(0.75);
  EXPECT_TRUE(Eventually([&] {
    return client.NewestSettings()->stiffness_n_per_mm == 0.75 &&
           facts()->settings->stiffness_n_per_mm == 0.75;
  }));
  EXPECT_EQ(facts()->volume->loaded_revision, client.GetVolume().loaded_revision);
  served_.data().Load("builtin:bumps:16");
  EXPECT_TRUE(Eventually([&] { return facts()->volume->source == "builtin:bumps:16"; }));
}

// A follower that reads when the test says so.
class Reader {
 public:
  explicit Reader(const std::string& socket)
      : stub_(v1::FactsService::NewStub(
            grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials()))) {
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    call_ = stub_->Follow(&context_);
  }
  bool Send(const v1::FollowRequest& request) { return call_->Write(request); }
  bool Start() {
    v1::FollowRequest request;
    request.mutable_start();
    return Send(request);
  }
  // Takes the next message.
  bool Read() {
    if (!call_->Read(&message_)) return false;
    facts_.MergeFrom(message_.facts());
    return true;
  }
  bool Acknowledge() {
    v1::FollowRequest request;
    request.mutable_acknowledgement()->set_message_number(message_.message_number());
    return Send(request);
  }
  const v1::Facts& facts() const { return facts_; }
  grpc::StatusCode Finish() {
    while (Read()) {
    }
    return call_->Finish().error_code();
  }
  void Cancel() { context_.TryCancel(); }

 private:
  std::unique_ptr<v1::FactsService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::FollowRequest, v1::FollowResponse>> call_;
  v1::FollowResponse message_;
  v1::Facts facts_;
};

TEST_F(FactsTest, WhoDoesNotReadDelaysNobodyAndThenSeesTheNewest) {
  Reader slow(socket_);
  ASSERT_TRUE(slow.Start() && slow.Read());
  client::Client client(Options());
  constexpr int kChanges = 300;
  for (int n = 1; n <= kChanges; ++n) {
    SetStiffness(0.001 * n);
    ASSERT_TRUE(Eventually([&] {
      const auto settings = client.NewestSettings();
      return settings && settings->stiffness_n_per_mm == 0.001 * n;
    })) << n;
  }
  // The next message is the newest: none waited.
  ASSERT_TRUE(slow.Acknowledge() && slow.Read());
  EXPECT_EQ(slow.facts().settings().settings().stiffness_n_per_mm(), 0.001 * kChanges);
  slow.Cancel();
}

// Sends a text that is not UTF-8, and waits for the acknowledgement.
class Unreadable final : public v1::FactsService::Service {
  grpc::Status Follow(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::FollowResponse, v1::FollowRequest>* stream) final {
    v1::FollowRequest request;
    v1::FollowResponse response;
    response.mutable_facts()->mutable_volume()->set_unit("\xb5m");
    stream->Write(response);
    while (stream->Read(&request)) {
    }
    return grpc::Status::OK;
  }
};

TEST(Facts, AMessageThatCannotBeReadEndsTheStream) {
  const test::TemporaryFolder folder;
  const std::string target = "unix:" + (folder.path() / "s").string();
  Unreadable service;
  grpc::ServerBuilder builder;
  builder.AddListeningPort(target, grpc::InsecureServerCredentials());
  builder.RegisterService(&service);
  const auto server = builder.BuildAndStart();
  const auto stub =
      v1::FactsService::NewStub(grpc::CreateChannel(target, grpc::InsecureChannelCredentials()));
  client::AcknowledgedCall<v1::FollowRequest, v1::FollowResponse> call(
      {}, [&](auto* context, auto* queue) { return stub->PrepareAsyncFollow(context, queue); });
  v1::FollowResponse message;
  EXPECT_TRUE(Eventually([&] {
    return call.Next(std::chrono::milliseconds(50), message) == client::CallEvent::kEnded;
  }));
  EXPECT_EQ(call.status().error_code(), grpc::StatusCode::INTERNAL);
}

TEST_F(FactsTest, AStreamBeginsWithAStart) {
  Reader reader(socket_);
  ASSERT_TRUE(reader.Send({}));
  EXPECT_EQ(reader.Finish(), grpc::StatusCode::INVALID_ARGUMENT);
  Reader twice(socket_);
  ASSERT_TRUE(twice.Start() && twice.Start());
  EXPECT_EQ(twice.Finish(), grpc::StatusCode::INVALID_ARGUMENT);
}

// Refused ones, too: more than one identity may have at once.
TEST_F(FactsTest, StreamsThatEndAtOnceHarmNobody) {
  std::vector<std::unique_ptr<Reader>> readers;
  for (int n = 0; n < 2 * kStreams; ++n) {
    readers.push_back(std::make_unique<Reader>(socket_));
    readers.back()->Start();
    if (n % 2 == 1) readers.back()->Cancel();
  }
  readers.clear();
  client::Client client(Options());
  EXPECT_TRUE(Eventually([&] { return client.NewestFacts()->volume.has_value(); }));
}

TEST_F(FactsTest, TheEndOfTheDaemonEndsTheStream) {
  Reader reader(socket_);
  ASSERT_TRUE(reader.Start() && reader.Read());
  EXPECT_EQ(reader.facts().caller().identity(), "local socket");
  served_.server().Stop();
  EXPECT_EQ(reader.Finish(), grpc::StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace palpate
