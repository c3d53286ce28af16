// A subscription to PoseService, acknowledged message by message.
#pragma once

#include <cstdint>
#include <memory>

#include "client/cli/connection.h"
#include "client/sdk/acknowledged_call.h"
#include "palpate/v1/pose.grpc.pb.h"

namespace palpate::cli {

// Samples are fresh however slow the reader of our output is; what it cannot take
// is dropped at the server.
//
// Threads: one. Ownership: borrows nothing; ends the call in its destructor.
class PoseStream {
 public:
  // `rate_hz` in (0, 1000] and `batch` in 1 to 256, as in StreamPosesStart.
  PoseStream(const Connection& connection, double rate_hz, std::uint32_t batch);

  // As AcknowledgedCall has them.
  CallEvent Next(std::chrono::milliseconds timeout, v1::StreamPosesResponse& message) {
    return call_.Next(timeout, message);
  }
  const grpc::Status& status() const { return call_.status(); }

 private:
  std::unique_ptr<v1::PoseService::Stub> stub_;
  AcknowledgedCall<v1::StreamPosesRequest, v1::StreamPosesResponse> call_;
};

}  // namespace palpate::cli
