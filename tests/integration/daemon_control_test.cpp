// Clients steer a real daemon: settings, volumes, errors.
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "tests/support/daemon.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

class ControlTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    daemon_ = std::make_unique<Daemon>(test::kPalpated,
                                       std::vector<std::string>{"--volume", "builtin:bumps:48"});
  }
  static void TearDownTestSuite() { daemon_.reset(); }

  static grpc::Status Update(const v1::UpdateSettingsRequest& request,
                             v1::UpdateSettingsResponse* response = nullptr) {
    grpc::ClientContext context;
    v1::UpdateSettingsResponse unused;
    return daemon_->render->UpdateSettings(&context, request, response ? response : &unused);
  }
  static v1::GetSettingsResponse Settings() {
    grpc::ClientContext context;
    v1::GetSettingsResponse response;
    EXPECT_TRUE(daemon_->render->GetSettings(&context, {}, &response).ok());
    return response;
  }
  static v1::VolumeDescription Volume() {
    grpc::ClientContext context;
    v1::GetVolumeResponse response;
    EXPECT_TRUE(daemon_->volume->GetVolume(&context, {}, &response).ok());
    return response.volume();
  }
  struct Load {
    grpc::Status status;
    int progress = 0;
    std::optional<v1::LoadVolumeResult> result;
  };
  static Load LoadVolume(const v1::LoadVolumeRequest& request) {
    grpc::ClientContext context;
    auto reader = daemon_->volume->LoadVolume(&context, request);
    Load load;
    for (v1::LoadVolumeResponse event; reader->Read(&event);) {
      if (event.has_result()) load.result = event.result();
      load.progress += event.has_progress();
    }
    load.status = reader->Finish();
    return load;
  }
  static ProcessResult Run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::kPalpate);
    arguments.insert(arguments.end(), {"--socket", daemon_->socket()});
    return Process(arguments).Wait();
  }

  static std::unique_ptr<Daemon> daemon_;
};
std::unique_ptr<Daemon> ControlTest::daemon_;

TEST_F(ControlTest, UpdatesNamedFieldsOnly) {
  v1::UpdateSettingsRequest request;
  request.mutable_settings()->set_stiffness_n_per_mm(0.9);
  request.mutable_settings()->set_damping_n_s_per_m(3.0);  // not in the mask
  request.mutable_settings()->set_method(v1::DECOMPOSITION_METHOD_BCC);
  request.mutable_update_mask()->add_paths("stiffness_n_per_mm");
  request.mutable_update_mask()->add_paths("method");
  v1::UpdateSettingsResponse response;
  ASSERT_TRUE(Update(request, &response).ok());
  EXPECT_EQ(response.settings().stiffness_n_per_mm(), 0.9);
  EXPECT_EQ(response.settings().damping_n_s_per_m(), 0.0);
  EXPECT_EQ(response.settings().method(), v1::DECOMPOSITION_METHOD_BCC);
  EXPECT_EQ(Settings().settings_revision(), response.settings_revision());
}

TEST_F(ControlTest, BadUpdatesAreRefusedAndChangeNothing) {
  const v1::GetSettingsResponse before = Settings();
  v1::UpdateSettingsRequest request;
  request.mutable_settings()->set_isovalue(0.3);
  EXPECT_EQ(Update(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);  // no mask
  request.mutable_update_mask()->add_paths("colour");
  EXPECT_EQ(Update(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.mutable_update_mask()->set_paths(0, "stiffness_n_per_mm");  // no value
  EXPECT_EQ(Update(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.mutable_update_mask()->set_paths(0, "isovalue");
  request.mutable_settings()->set_isovalue(17.0);
  const grpc::Status out_of_range = Update(request);
  EXPECT_EQ(out_of_range.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_NE(out_of_range.error_message().find("isovalue 17 is not within 0 to 1"),
            std::string::npos);
  request.mutable_settings()->set_isovalue(0.3);
  request.set_expected_revision(before.settings_revision() + 5);
  EXPECT_EQ(Update(request).error_code(), grpc::StatusCode::ABORTED);
  EXPECT_EQ(Settings().SerializeAsString(), before.SerializeAsString());
}

TEST_F(ControlTest, LoadsAVolumeAndKeepsItWhenAnotherFails) {
  v1::LoadVolumeRequest request;
  request.set_source("builtin:gyroid:64");
  request.set_normalized_isovalue(0.4);
  request.mutable_spacing_mm()->set_x(0.5);
  request.mutable_spacing_mm()->set_y(0.5);
  request.mutable_spacing_mm()->set_z(1.0);
  const Load good = LoadVolume(request);
  ASSERT_TRUE(good.status.ok()) << good.status.error_message();
  ASSERT_TRUE(good.result.has_value());
  EXPECT_GT(good.progress, 0);
  EXPECT_EQ(good.result->volume().size_x(), 64u);
  EXPECT_EQ(good.result->volume().spacing_mm().z(), 1.0);
  EXPECT_NEAR(Settings().settings().normalized_isovalue(), 0.4, 1e-9);

  TemporaryFolder folder;
  std::ofstream(folder.path() / "truncated.nrrd")
      << "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 64 64 64\nencoding: raw\n\nabc";
  std::ofstream(folder.path() / "text.nrrd") << "no volume";
  const v1::VolumeDescription before = Volume();
  for (const char* bad : {"truncated.nrrd", "text.nrrd", "absent.nrrd", "."}) {
    v1::LoadVolumeRequest bad_request;
    bad_request.set_source((folder.path() / bad).string());
    const Load load = LoadVolume(bad_request);
    EXPECT_FALSE(load.status.ok()) << bad;
    EXPECT_NE(load.status.error_code(), grpc::StatusCode::INTERNAL) << load.status.error_message();
    EXPECT_EQ(load.status.error_message().find('\n'), std::string::npos);
    std::printf("%s: %s\n", bad, load.status.error_message().c_str());
  }
  EXPECT_EQ(Volume().SerializeAsString(), before.SerializeAsString());
}

TEST_F(ControlTest, TheClientSteers) {
  ProcessResult result = Run({"set", "isovalue", "--normalized", "0.45"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_NE(result.output.find("applied at tick"), std::string::npos) << result.output;
  EXPECT_NEAR(Settings().settings().normalized_isovalue(), 0.45, 1e-9);
  result = Run({"set", "stiffness", "99"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_NE(result.error.find("stiffness_n_per_mm 99 is not within 0 to 3 N/mm"), std::string::npos)
      << result.error;
  result = Run({"load", "builtin:sphere:40"});
  EXPECT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(Volume().source(), "builtin:sphere:40");
  result = Run({"info"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.output.find("builtin:sphere:40"), std::string::npos);
  EXPECT_EQ(Run({"settings", "--json"}).exit_code, 0);
}

TEST_F(ControlTest, AnswersHealthAndReflection) {
  // No generated code for these in Debian: an empty HealthCheckRequest, and a
  // HealthCheckResponse whose field 1 says SERVING (1).
  grpc::GenericStub stub(daemon_->channel());
  const auto call = [&](const char* method, const std::string& bytes) {
    grpc::ClientContext context;
    grpc::CompletionQueue queue;
    const grpc::Slice slice(bytes);
    const grpc::ByteBuffer request(&slice, 1);
    auto rpc = stub.PrepareUnaryCall(&context, method, request, &queue);
    rpc->StartCall();
    grpc::ByteBuffer response;
    grpc::Status status;
    rpc->Finish(&response, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    EXPECT_TRUE(status.ok()) << status.error_message();
    grpc::Slice single;
    response.DumpToSingleSlice(&single);
    return std::string(single.begin(), single.end());
  };
  EXPECT_EQ(call("/grpc.health.v1.Health/Check", ""), std::string("\x08\x01"));
  // list_services (field 7).
  const std::string services = call(
      "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", std::string("\x3a\x01*"));
  EXPECT_NE(services.find("palpate.v1.PoseService"), std::string::npos);
}

}  // namespace
}  // namespace palpate::test
