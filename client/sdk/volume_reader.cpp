#include "client/sdk/volume_reader.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "client/sdk/acknowledged_call.h"
#include "common/bricks/volume_event.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "common/wire/volume_message.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::client {

// One call of VolumeService.StreamVolume, acknowledged message by message.
//
// Threads: one. Ownership: borrows nothing; ends the call in its destructor.
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

v1::StreamVolumeRequest Start(std::uint32_t max_unacknowledged,
                              const std::optional<VolumeRevision>& resume_from) {
  v1::StreamVolumeRequest request;
  request.mutable_start()->set_max_unacknowledged(max_unacknowledged);
  if (resume_from) *request.mutable_start()->mutable_resume_from() = ToProto(*resume_from);
  return request;
}

VolumeCall::VolumeCall(const std::shared_ptr<grpc::Channel>& channel,
                       std::uint32_t max_unacknowledged,
                       const std::optional<VolumeRevision>& resume_from)
    : stub_(v1::VolumeService::NewStub(channel)),
      call_(Start(max_unacknowledged, resume_from), [this](auto* context, auto* queue) {
        return stub_->PrepareAsyncStreamVolume(context, queue);
      }) {}

namespace {

// If the copy is damaged this often in a row, fetching it again does not help.
constexpr int kMostDamaged = 3;

bool IsWorthTrying(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::NOT_FOUND:
    case grpc::StatusCode::PERMISSION_DENIED:
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::UNIMPLEMENTED:
      return false;
    default:
      return true;
  }
}

Error ErrorOf(const grpc::Status& status) {
  if (status.ok()) return {ErrorKind::kUnavailable, "palpated ended the stream"};
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
    return {ErrorKind::kUnavailable,
            "this palpated does not stream its volume: it is of an older version"};
  }
  return FromStatus(status);
}

}  // namespace

VolumeReader::VolumeReader(std::shared_ptr<grpc::Channel> channel, VolumeMirror& mirror,
                           const VolumeReaderOptions& options)
    : channel_(std::move(channel)), mirror_(mirror), options_(options) {}

VolumeReader::~VolumeReader() = default;

VolumeReader::Event VolumeReader::Next(std::chrono::milliseconds timeout) {
  const auto deadline = Clock::now() + timeout;
  if (!call_) {
    if (try_again_ > deadline) {
      std::this_thread::sleep_until(deadline);
      return Event::kTimeout;
    }
    std::this_thread::sleep_until(try_again_);
    call_ = std::make_unique<VolumeCall>(channel_, options_.max_unacknowledged, mirror_.resume());
  }
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
  v1::StreamVolumeResponse response;
  switch (call_->Next(std::max(left, std::chrono::milliseconds(0)), response)) {
    case CallEvent::kTimeout:
      return Event::kTimeout;
    case CallEvent::kEnded:
      return End(call_->status());
    case CallEvent::kMessage:
      break;
  }
  losses_in_a_row_ = 0;
  bytes_received_ += response.ByteSizeLong();
  try {
    const VolumeMessage message = palpate::FromProto(std::move(response));
    mirror_.Apply(message.event);
    if (!std::holds_alternative<VolumeComplete>(message.event)) return Event::kApplied;
    damaged_in_a_row_ = 0;
    return Event::kComplete;
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kTooLarge || ++damaged_in_a_row_ >= kMostDamaged) throw;
    mirror_.Reset();
    return Lose(error);
  }
}

VolumeReader::Event VolumeReader::End(const grpc::Status& status) {
  const Error error = ErrorOf(status);
  if (!IsWorthTrying(status.error_code())) {
    // Only a resumed stream can be refused for its revision. Without the revision, the next stream
    // is valid.
    const bool resumed =
        status.error_code() == grpc::StatusCode::INVALID_ARGUMENT && mirror_.resume().has_value();
    if (!resumed) throw error;
    mirror_.Reset();
  }
  return Lose(error);
}

VolumeReader::Event VolumeReader::Lose(const Error& error) {
  call_.reset();
  last_loss_ = error;
  ++losses_;
  if (is_loading()) losses_in_a_row_ = 0;
  const int doublings = std::min(losses_in_a_row_++, 16);
  try_again_ =
      Clock::now() + std::min(options_.first_pause * (1 << doublings), options_.longest_pause);
  return Event::kLost;
}

}  // namespace palpate::client
