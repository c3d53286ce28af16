// A call of which a signal cancels every step.
//
// Threads: main only.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>

#include "client/interrupt/interrupt.h"

namespace palpate::cli {

// Needs an Interrupt. Begin the call with PrepareAsync...(&context(), ..., &queue())
// and the tag `this`, then follow each step with Wait(). End it with Finish().
class CancellableCall {
 public:
  CancellableCall() = default;
  CancellableCall(const CancellableCall&) = delete;
  CancellableCall& operator=(const CancellableCall&) = delete;
  ~CancellableCall() {
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  grpc::ClientContext& context() { return context_; }
  grpc::CompletionQueue& queue() { return queue_; }

  // False when the step failed; Finish says why.
  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    while (queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kInterruptPoll) ==
           grpc::CompletionQueue::TIMEOUT) {
      if (Interrupt::IsRaised()) context_.TryCancel();
    }
    return ok;
  }

  template <typename Call>
  grpc::Status Finish(Call& call) {
    grpc::Status status;
    call.Finish(&status, this);
    Wait();
    return status;
  }

 private:
  static constexpr std::chrono::milliseconds kInterruptPoll{50};
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
};

// A call that answers with a stream of messages.
template <typename Response>
class StreamCall {
 public:
  // start(context, queue) prepares it.
  template <typename Start>
  explicit StreamCall(Start start) : call_(start(&base_.context(), &base_.queue())) {
    call_->StartCall(&base_);
    base_.Wait();
  }
  ~StreamCall() {
    // A call that is abandoned, because our output broke, must end too.
    if (finished_) return;
    base_.context().TryCancel();
    Finish();
  }
  StreamCall(const StreamCall&) = delete;
  StreamCall& operator=(const StreamCall&) = delete;

  bool Read(Response& response) {
    call_->Read(&response, &base_);
    return base_.Wait();
  }
  grpc::Status Finish() {
    finished_ = true;
    return base_.Finish(*call_);
  }

 private:
  CancellableCall base_;
  bool finished_ = false;
  std::unique_ptr<grpc::ClientAsyncReader<Response>> call_;
};

}  // namespace palpate::cli
