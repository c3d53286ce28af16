#include "client/sdk/volume_call.h"

#include "common/wire/volume_message.h"

namespace palpate {
namespace {

void* Tag(std::intptr_t step) { return reinterpret_cast<void*>(step); }

}  // namespace

VolumeCall::VolumeCall(const std::shared_ptr<grpc::Channel>& channel,
                       std::uint32_t max_unacknowledged,
                       const std::optional<VolumeRevision>& resume_from)
    : stub_(v1::VolumeService::NewStub(channel)),
      call_(stub_->PrepareAsyncStreamVolume(&context_, &queue_)) {
  start_.mutable_start()->set_max_unacknowledged(max_unacknowledged);
  if (resume_from) *start_.mutable_start()->mutable_resume_from() = ToProto(*resume_from);
  call_->StartCall(Tag(kStart));
}

VolumeCall::~VolumeCall() {
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

VolumeCall::Event VolumeCall::Next(std::chrono::milliseconds timeout,
                                   v1::StreamVolumeResponse& message) {
  if (ended_) {
    return Event::kEnded;
  }
  if (has_message_) {
    has_message_ = false;
    taken_number_ = delivered_number_;
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
      delivered_number_ = received_.message_number();
      message.Swap(&received_);
      return Event::kMessage;
    }
  }
}

void VolumeCall::Proceed(Step step, bool ok) {
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
        v1::StreamVolumeRequest request;
        request.mutable_acknowledgement()->set_message_number(taken_number_);
        Write(request);
      }
      break;
    case kFinish:
      ended_ = true;
      break;
  }
}

void VolumeCall::Read() {
  reading_ = true;
  call_->Read(&received_, Tag(kRead));
}

void VolumeCall::Write(const v1::StreamVolumeRequest& request) {
  writing_ = true;
  call_->Write(request, Tag(kWrite));
}

void VolumeCall::Finish() {
  if (!finishing_) {
    finishing_ = true;
    call_->Finish(&status_, Tag(kFinish));
  }
}

}  // namespace palpate
