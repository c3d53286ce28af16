// One call of VolumeService.StreamVolume, acknowledged message by message.
//
// Threads: one. Ownership: borrows nothing; ends the call in its destructor.
#pragma once

#include <memory>
#include <optional>

#include "client/sdk/acknowledged_call.h"
#include "common/bricks/volume_event.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::client {

class VolumeCall {
 public:
  VolumeCall(const std::shared_ptr<grpc::Channel>& channel, std::uint32_t max_unacknowledged,
             const std::optional<VolumeRevision>& resume_from);

  // See AcknowledgedCall.
  CallEvent Next(std::chrono::milliseconds timeout, v1::StreamVolumeResponse& message) {
    return call_.Next(timeout, message);
  }
  const grpc::Status& status() const { return call_.status(); }

 private:
  std::unique_ptr<v1::VolumeService::Stub> stub_;
  AcknowledgedCall<v1::StreamVolumeRequest, v1::StreamVolumeResponse> call_;
};

}  // namespace palpate::client
