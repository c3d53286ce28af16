#include "server/rpc/pose_service.h"

#include <memory>
#include <mutex>
#include <optional>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/realtime/tick_timer.h"
#include "server/rpc/pose_stream.h"

namespace palpate {
namespace {

class PoseReactor final
    : public grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>,
      public SampleSink,
      public std::enable_shared_from_this<PoseReactor> {
 public:
  // The stream lives until OnDone.
  void Begin(Pump& pump, std::shared_ptr<PoseReactor> self) {
    pump_ = &pump;
    self_ = std::move(self);
    StartRead(&request_);
  }

  void OnSample(const TickSample& sample) override {
    const std::lock_guard lock(mutex_);
    if (finished_ || !stream_) return;
    stream_->Add(sample);
    WriteIfPossible();
  }

  void OnReadDone(bool ok) override {
    const bool started = HandleRead(ok);
    // Not under the lock: the pump locks its sinks first and this stream then.
    if (started) pump_->Subscribe(weak_from_this(), Pump::Feed::kShown);
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    if (!ok) {
      FinishOnce(grpc::Status::CANCELLED);
      return;
    }
    WriteIfPossible();
  }

  void OnCancel() override {
    const std::lock_guard lock(mutex_);
    FinishOnce(grpc::Status::CANCELLED);
  }

  void OnDone() override { const std::shared_ptr<PoseReactor> last = std::move(self_); }

 private:
  // True when this request started the stream.
  bool HandleRead(bool ok) {
    const std::lock_guard lock(mutex_);
    if (finished_) return false;
    if (!ok) {
      // The client has closed its side. A stream without acknowledgements goes
      // on; with them it would stop for want of credit.
      if (!stream_ || acknowledges_) FinishOnce(EndStatus());
      return false;
    }
    const bool was_started = stream_.has_value();
    const grpc::Status status = Take(request_);
    if (!status.ok()) {
      FinishOnce(status);
      return false;
    }
    WriteIfPossible();
    StartRead(&request_);
    return !was_started;
  }

  grpc::Status EndStatus() const {
    if (stream_) return grpc::Status::OK;
    return {grpc::StatusCode::INVALID_ARGUMENT, "the first request must be `start`"};
  }

  grpc::Status Take(const v1::StreamPosesRequest& request) {
    if (request.has_start()) {
      if (stream_) return {grpc::StatusCode::INVALID_ARGUMENT, "`start` comes once"};
      try {
        const PoseStreamOptions options = ParsePoseStreamOptions(request.start());
        stream_.emplace(options);
        acknowledges_ = options.max_unacknowledged.has_value();
      } catch (const Error& error) {
        return ToStatus(error);
      }
      return grpc::Status::OK;
    }
    if (!stream_) return EndStatus();
    if (!request.has_acknowledgement()) {
      return {grpc::StatusCode::INVALID_ARGUMENT, "a request after `start` must acknowledge"};
    }
    stream_->Acknowledge(request.acknowledgement().message_number());
    return grpc::Status::OK;
  }

  void WriteIfPossible() {
    if (finished_ || writing_ || !stream_ || !stream_->HasMessage()) return;
    response_ = stream_->TakeMessage(MonotonicNowNs());
    writing_ = true;
    StartWrite(&response_);
  }

  void FinishOnce(const grpc::Status& status) {
    if (finished_) return;
    finished_ = true;
    Finish(status);
  }

  Pump* pump_ = nullptr;
  std::shared_ptr<PoseReactor> self_;
  v1::StreamPosesRequest request_;

  std::mutex mutex_;  // guards what follows
  std::optional<PoseStream> stream_;
  bool acknowledges_ = false;
  bool writing_ = false;
  bool finished_ = false;
  v1::StreamPosesResponse response_;
};

}  // namespace

grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>* PoseService::StreamPoses(
    grpc::CallbackServerContext*) {
  auto reactor = std::make_shared<PoseReactor>();
  PoseReactor* raw = reactor.get();
  raw->Begin(pump_, std::move(reactor));
  return raw;
}

}  // namespace palpate
