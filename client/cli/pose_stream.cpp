#include "client/cli/pose_stream.h"

namespace palpate::cli {
namespace {

constexpr std::uint32_t kMaxUnacknowledged = 4;

v1::StreamPosesRequest Start(double rate_hz, std::uint32_t batch) {
  v1::StreamPosesRequest request;
  request.mutable_start()->set_rate_hz(rate_hz);
  request.mutable_start()->set_batch(batch);
  request.mutable_start()->set_max_unacknowledged(kMaxUnacknowledged);
  return request;
}

}  // namespace

PoseStream::PoseStream(const Connection& connection, double rate_hz, std::uint32_t batch)
    : stub_(v1::PoseService::NewStub(connection.channel())),
      call_(Start(rate_hz, batch), [this](auto* context, auto* queue) {
        return stub_->PrepareAsyncStreamPoses(context, queue);
      }) {}

}  // namespace palpate::cli
