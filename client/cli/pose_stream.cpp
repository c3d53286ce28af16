#include "client/cli/pose_stream.h"

#include <utility>

namespace palpate::cli {
namespace {

constexpr std::uint32_t kMaxUnacknowledged = 4;

void* Tag(std::intptr_t step) { return reinterpret_cast<void*>(step); }

}  // namespace

PoseStream::PoseStream(const Connection& connection, double rate_hz, std::uint32_t batch)
    : stub_(v1::PoseService::NewStub(connection.channel())),
      call_(stub_->PrepareAsyncStreamPoses(&context_, &queue_)) {
  start_.mutable_start()->set_rate_hz(rate_hz);
  start_.mutable_start()->set_batch(batch);
  start_.mutable_start()->set_max_unacknowledged(kMaxUnacknowledged);
  call_->StartCall(Tag(kStart));
}

PoseStream::~PoseStream() {
  context_.TryCancel();
  if (started_ && !reading_) {
    Finish();
  }
  void* tag = nullptr;
  bool ok = false;
  while (!ended_ && queue_.Next(&tag, &ok)) {
    has_message_ = false;
    Proceed(static_cast<Step>(reinterpret_cast<std::intptr_t>(tag)), ok);
    if (has_message_) {
      Finish();
    }
  }
  queue_.Shutdown();
  while (queue_.Next(&tag, &ok)) {
  }
}

PoseStream::Event PoseStream::Next(std::chrono::milliseconds timeout,
                                   v1::StreamPosesResponse& message) {
  if (ended_) {
    return Event::kEnded;
  }
  if (has_message_) {
    has_message_ = false;
    taken_number_ = received_.message_number();
    Read();
    if (!writing_) {
      Proceed(kWrite, true);
    }
  }
  const auto deadline = std::chrono::system_clock::now() + timeout;
  while (true) {
    void* tag = nullptr;
    bool ok = false;
    if (queue_.AsyncNext(&tag, &ok, deadline) != grpc::CompletionQueue::GOT_EVENT) {
      return Event::kTimeout;
    }
    Proceed(static_cast<Step>(reinterpret_cast<std::intptr_t>(tag)), ok);
    if (ended_) {
      return Event::kEnded;
    }
    if (has_message_) {
      message = received_;
      return Event::kMessage;
    }
  }
}

void PoseStream::Proceed(Step step, bool ok) {
  switch (step) {
    case kStart:
      started_ = true;
      if (ok) {
        Write(start_);
        Read();
      } else {
        Finish();
      }
      break;
    case kRead:
      reading_ = false;
      has_message_ = ok;
      if (!ok) {
        Finish();
      }
      break;
    case kWrite:
      writing_ = false;
      // The newest acknowledgement stands for all before it.
      if (ok && !finishing_ && acknowledged_number_ != taken_number_) {
        acknowledged_number_ = taken_number_;
        v1::StreamPosesRequest request;
        request.mutable_acknowledgement()->set_message_number(taken_number_);
        Write(request);
      }
      break;
    case kFinish:
      ended_ = true;
      break;
  }
}

void PoseStream::Read() {
  reading_ = true;
  call_->Read(&received_, Tag(kRead));
}

void PoseStream::Write(const v1::StreamPosesRequest& request) {
  writing_ = true;
  call_->Write(request, Tag(kWrite));
}

void PoseStream::Finish() {
  if (!finishing_) {
    finishing_ = true;
    call_->Finish(&status_, Tag(kFinish));
  }
}

}  // namespace palpate::cli
