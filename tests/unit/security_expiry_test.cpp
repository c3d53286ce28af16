// A client's certificate that expires while its stream runs.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <utility>

#include "palpate/v1/pose.grpc.pb.h"
#include "server/door/access.h"
#include "server/door/entrance.h"
#include "server/door/security_files.h"
#include "tests/support/certificates.h"

namespace palpate {
namespace {

constexpr std::chrono::hours kDay{24};

// A stream that lasts until it is cancelled, as all of ours are.
class EndlessStream final
    : public grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse> {
 public:
  explicit EndlessStream(Admission admission) : admission_(std::move(admission)) {
    StartSendInitialMetadata();
  }
  void OnCancel() override { Finish(grpc::Status::CANCELLED); }
  void OnDone() override { delete this; }

 private:
  Admission admission_;
};

class EndlessPoses final : public v1::PoseService::CallbackService {
 public:
  explicit EndlessPoses(Access& access) : access_(access) {}

  grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>* StreamPoses(
      grpc::CallbackServerContext* context) override {
    Admission admission = access_.Admit(context, "/palpate.v1.PoseService/StreamPoses");
    if (!admission.ok()) {
      return new RefusedStream<v1::StreamPosesRequest, v1::StreamPosesResponse>(
          std::move(admission));
    }
    return new EndlessStream(std::move(admission));
  }

 private:
  Access& access_;
};

class SecurityExpiry : public ::testing::Test, protected test::Certificates {
 protected:
  void SetUp() override {
    MakeAuthority("lab");
    Issue("lab", "server", "DNS:localhost");
    Issue("lab", "viewer", "DNS:viewer.example", 10);
    tls_ = std::make_unique<TlsFiles>(TlsOptions{In("server.pem"), In("server.key")}, In("tls"));
    files_ = std::make_unique<SecurityFiles>(access_, tls_.get());
    files_->Start(
        {.client_ca = In("lab.pem"), .clients = {{"viewer.example", Role::kViewer}}, .tokens = {}},
        {In("server.pem"), In("server.key")});
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", tls_->MakeCredentials(), &port_);
    builder.RegisterService(&service_);
    builder.SetContextAllocator(entrance_.MakeContexts());
    server_ = builder.BuildAndStart();
    ASSERT_NE(server_, nullptr);
  }
  void TearDown() override {
    server_->Shutdown(std::chrono::system_clock::now());
    files_->Stop();
  }

  std::unique_ptr<v1::PoseService::Stub> Viewer() const {
    const auto credentials =
        grpc::SslCredentials({Read("lab.pem"), Read("viewer.key"), Read("viewer.pem")});
    return v1::PoseService::NewStub(
        grpc::CreateChannel("localhost:" + std::to_string(port_), credentials));
  }

  // A minute on: what the tests make is valid from now, to the second.
  std::atomic<std::chrono::system_clock::time_point> now_{std::chrono::system_clock::now() +
                                                          std::chrono::minutes(1)};
  Access access_{LimitOptions{}, nullptr, [this] { return now_.load(); }};
  EndlessPoses service_{access_};
  ConnectionWatch watch_{0};
  Entrance entrance_{{Transport::kTls}, 0, 0, watch_};
  std::unique_ptr<TlsFiles> tls_;
  std::unique_ptr<SecurityFiles> files_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
};

TEST_F(SecurityExpiry, EndsTheStreamThatBeganWithIt) {
  now_ = now_.load() + 9 * kDay;
  const auto stub = Viewer();
  grpc::ClientContext context;
  // Long after the next look at running calls, which is 2 s away at most.
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  const auto stream = stub->StreamPoses(&context);
  stream->WaitForInitialMetadata();
  now_ = now_.load() + 2 * kDay;
  v1::StreamPosesResponse message;
  EXPECT_FALSE(stream->Read(&message));
  const grpc::Status status = stream->Finish();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::CANCELLED) << status.error_message();
  // And no other one begins.
  grpc::ClientContext again;
  const auto refused = stub->StreamPoses(&again);
  EXPECT_EQ(refused->Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED);
}

}  // namespace
}  // namespace palpate
