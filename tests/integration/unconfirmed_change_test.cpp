// Changes that take effect although no servo confirms them: their callers get an error, and the
// others must see who made them.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <future>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/wire/values.h"
#include "palpate/v1/activity.grpc.pb.h"
#include "palpate/v1/registration.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"
#include "tests/support/patience.h"
#include "tests/support/served_session.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

bool IsNoted(const std::shared_ptr<grpc::Channel>& channel, const std::string& what) {
  grpc::ClientContext context;
  v1::GetActivityResponse response;
  const auto stub = v1::ActivityService::NewStub(channel);
  EXPECT_TRUE(stub->GetActivity(&context, {}, &response).ok());
  for (const v1::LastChange& change : response.changes()) {
    if (change.what() == what) return true;
  }
  return false;
}

grpc::Status Load(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  v1::LoadVolumeRequest request;
  request.set_source("builtin:sphere:24");
  const auto stub = v1::VolumeService::NewStub(channel);
  const auto events = stub->LoadVolume(&context, request);
  v1::LoadVolumeResponse event;
  while (events->Read(&event)) {
  }
  return events->Finish();
}

grpc::Status Edit(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  v1::EditVolumeRequest request;
  request.set_frame(v1::EDIT_FRAME_INDEX);
  request.set_operation(v1::EDIT_OPERATION_ADD);
  request.set_value(0.01);
  *request.mutable_sphere() = ToProto(SphereShape{Vec3(8, 8, 8), 3.0});
  v1::EditVolumeResponse response;
  return v1::VolumeService::NewStub(channel)->EditVolume(&context, request, &response);
}

grpc::Status Move(const std::shared_ptr<grpc::Channel>& channel) {
  grpc::ClientContext context;
  v1::UpdateRegistrationRequest request;
  request.mutable_translate_mm()->set_x(1.0);
  v1::UpdateRegistrationResponse response;
  return v1::RegistrationService::NewStub(channel)->UpdateRegistration(&context, request,
                                                                       &response);
}

TEST(UnconfirmedChange, IsNotedLikeAnyOther) {
  const test::TemporaryFolder folder;
  const std::string socket = folder.path() / "palpated.sock";
  testing::ServedSession served(socket);
  served.server().Reserve();
  served.data().Load("builtin:sphere:16");
  served.server().Start();
  const auto channel = grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials());
  std::vector<std::future<grpc::Status>> calls;
  for (const auto& [what, call] :
       {std::pair("volume", &Load), std::pair("voxels", &Edit), std::pair("placement", &Move)}) {
    EXPECT_FALSE(IsNoted(channel, what));
    calls.push_back(std::async(std::launch::async, call, channel));
    EXPECT_TRUE(test::Eventually([&, &what = what] { return IsNoted(channel, what); })) << what;
  }
  for (auto& call : calls) {
    const grpc::Status status = call.get();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
  }
}

}  // namespace
}  // namespace palpate
