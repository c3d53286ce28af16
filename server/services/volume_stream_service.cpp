#include "server/services/volume_stream_service.h"

#include <memory>
#include <mutex>
#include <utility>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "common/wire/volume_message.h"

namespace palpate {
namespace {

class VolumeReactor final : public VolumeStreamReactor,
                            public VolumeSink,
                            public std::enable_shared_from_this<VolumeReactor> {
 public:
  VolumeReactor(VolumeStreams& streams, Admission admission)
      : streams_(streams), admission_(std::move(admission)) {}

  // The stream keeps itself alive until OnDone.
  void Begin(std::shared_ptr<VolumeReactor> self) {
    self_ = std::move(self);
    StartRead(&request_);
  }

  bool Write(VolumeMessage message) override {
    const std::lock_guard lock(mutex_);
    if (finished_) return false;
    response_ = ToProto(std::move(message));
    admission_.SendsVoxels(response_.ByteSizeLong());
    StartWrite(&response_);
    return true;
  }

  void End() override { FinishOnce({grpc::StatusCode::UNAVAILABLE, "palpated is ending"}); }

  void OnReadDone(bool ok) override {
    request_.DiscardUnknownFields();  // megabytes of them would stay with the stream
    if (!ok) {
      // The client has closed its side: there will be no acknowledgements.
      FinishOnce(stream_ ? grpc::Status::OK : MissingStart());
      return;
    }
    try {
      Take(request_);
    } catch (const std::exception& error) {
      FinishOnce(ToStatus(error));
      return;
    }
    const std::lock_guard lock(mutex_);
    if (!finished_) StartRead(&request_);
  }

  void OnWriteDone(bool ok) override {
    if (ok) {
      streams_.WriteDone(*stream_);
    } else {
      FinishOnce(grpc::Status::CANCELLED);
    }
  }

  void OnCancel() override { FinishOnce(grpc::Status::CANCELLED); }

  void OnDone() override {
    // The streams may hold this one a little longer than gRPC its context.
    admission_.Leave();
    if (stream_) streams_.Unsubscribe(*stream_);
    const std::shared_ptr<VolumeReactor> last = std::move(self_);
  }

 private:
  static grpc::Status MissingStart() {
    return {grpc::StatusCode::INVALID_ARGUMENT, "the first request must be `start`"};
  }

  // Throws Error for a request that is not allowed now.
  void Take(const v1::StreamVolumeRequest& request) {
    if (request.has_start()) {
      if (stream_) throw Error(ErrorKind::kInvalidArgument, "`start` comes once");
      Start(request.start());
      return;
    }
    if (!stream_) throw Error(ErrorKind::kInvalidArgument, "the first request must be `start`");
    if (!request.has_acknowledgement()) {
      throw Error(ErrorKind::kInvalidArgument, "a request after `start` must acknowledge");
    }
    streams_.Acknowledge(*stream_, request.acknowledgement().message_number());
  }

  void Start(const v1::StreamVolumeStart& start) {
    VolumeFeedOptions options;
    options.max_unacknowledged = start.max_unacknowledged();
    if (start.has_resume_from()) options.resume_from = FromProto(start.resume_from());
    // The streams may start the first write before Subscribe returns. The write then waits for the
    // lock, so its end finds stream_ set.
    const std::lock_guard lock(mutex_);
    stream_ = streams_.Subscribe(options, weak_from_this());
  }

  void FinishOnce(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    finished_ = true;
    Finish(status);
  }

  VolumeStreams& streams_;
  Admission admission_;
  std::shared_ptr<VolumeReactor> self_;
  v1::StreamVolumeRequest request_;

  std::mutex mutex_;  // guards the members below, and the start of reads and writes
  bool finished_ = false;
  v1::StreamVolumeResponse response_;
  std::shared_ptr<VolumeStreams::Stream> stream_;
};

}  // namespace

VolumeStreamReactor* StreamVolumeTo(VolumeStreams& streams, Admission admission) {
  auto reactor = std::make_shared<VolumeReactor>(streams, std::move(admission));
  VolumeReactor* raw = reactor.get();
  raw->Begin(std::move(reactor));
  return raw;
}

}  // namespace palpate
