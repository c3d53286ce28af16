#include "client/sdk/volume_call.h"

#include "common/wire/values.h"

namespace palpate::client {
namespace {

v1::StreamVolumeRequest Start(std::uint32_t max_unacknowledged,
                              const std::optional<VolumeRevision>& resume_from) {
  v1::StreamVolumeRequest request;
  request.mutable_start()->set_max_unacknowledged(max_unacknowledged);
  if (resume_from) *request.mutable_start()->mutable_resume_from() = ToProto(*resume_from);
  return request;
}

}  // namespace

VolumeCall::VolumeCall(const std::shared_ptr<grpc::Channel>& channel,
                       std::uint32_t max_unacknowledged,
                       const std::optional<VolumeRevision>& resume_from)
    : stub_(v1::VolumeService::NewStub(channel)),
      call_(Start(max_unacknowledged, resume_from), [this](auto* context, auto* queue) {
        return stub_->PrepareAsyncStreamVolume(context, queue);
      }) {}

}  // namespace palpate::client
