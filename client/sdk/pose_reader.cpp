#include "client/sdk/pose_reader.h"

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/link.h"
#include "common/wire/values.h"
#include "palpate/v1/pose.grpc.pb.h"

namespace palpate::client {
namespace {

constexpr std::uint32_t kMaxUnacknowledged = 4;

v1::StreamPosesRequest StartOf(double rate_hz, std::uint32_t batch) {
  v1::StreamPosesRequest request;
  request.mutable_start()->set_rate_hz(rate_hz);
  request.mutable_start()->set_batch(batch);
  request.mutable_start()->set_max_unacknowledged(kMaxUnacknowledged);
  return request;
}

}  // namespace

struct PoseReader::Call {
  Call(Link& link, double rate_hz, std::uint32_t batch)
      : stub(v1::PoseService::NewStub(link.channel())),
        stream(StartOf(rate_hz, batch), [this](auto* context, auto* queue) {
          return stub->PrepareAsyncStreamPoses(context, queue);
        }) {}

  const std::unique_ptr<v1::PoseService::Stub> stub;
  AcknowledgedCall<v1::StreamPosesRequest, v1::StreamPosesResponse> stream;
  v1::StreamPosesResponse message;
};

PoseReader::PoseReader(Link& link, double rate_hz, std::uint32_t batch) : link_(&link) {
  link.ThrowIfCancelled();
  call_ = std::make_unique<Call>(link, rate_hz, batch);
}
PoseReader::~PoseReader() = default;
PoseReader::PoseReader(PoseReader&&) noexcept = default;
PoseReader& PoseReader::operator=(PoseReader&&) noexcept = default;

std::optional<PoseBatch> PoseReader::Next(std::chrono::milliseconds timeout) {
  link_->ThrowIfCancelled();
  switch (call_->stream.Next(timeout, call_->message)) {
    case CallEvent::kTimeout:
      return std::nullopt;
    case CallEvent::kEnded:
      throw link_->ErrorOfEnd(call_->stream.status());
    case CallEvent::kMessage:
      break;
  }
  PoseBatch batch;
  batch.received = std::chrono::steady_clock::now();
  for (const v1::PoseSample& sample : call_->message.samples()) {
    batch.poses.push_back(palpate::FromProto(sample));
  }
  batch.dropped = call_->message.dropped_samples();
  batch.sent_time_ns = call_->message.sent_time_ns();
  return batch;
}

}  // namespace palpate::client
