// A call whose steps can all be cancelled: while it waits, it asks every 50 ms whether to go on.
//
// Threads: one.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <exception>
#include <functional>
#include <utility>

namespace palpate::client {

// Begin the call with PrepareAsync...(&context(), ..., &queue()) and the tag `this`, then follow
// each step with Wait(). End it with Finish().
class PolledCall {
 public:
  // `goes_on`: false cancels the call.
  PolledCall(grpc::ClientContext& context, std::function<bool()> goes_on)
      : context_(context), goes_on_(std::move(goes_on)) {}
  PolledCall(const PolledCall&) = delete;
  PolledCall& operator=(const PolledCall&) = delete;
  ~PolledCall() {
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  grpc::ClientContext& context() { return context_; }
  grpc::CompletionQueue& queue() { return queue_; }
  bool is_cancelled() const { return is_cancelled_; }

  // Returns false if the step failed; Finish throws the reason.
  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    while (queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kPoll) ==
           grpc::CompletionQueue::TIMEOUT) {
      Ask();
    }
    return ok;
  }
  void Ask() {
    if (is_cancelled_) return;
    try {
      is_cancelled_ = !goes_on_();
    } catch (...) {
      // Keep the exception for Finish: until then gRPC may write to the arguments of this step.
      thrown_ = std::current_exception();
      is_cancelled_ = true;
    }
    if (is_cancelled_) context_.TryCancel();
  }

  // Throws the exception of goes_on, if there is one.
  template <typename Call>
  grpc::Status Finish(Call& call) {
    grpc::Status status;
    call.Finish(&status, this);
    Wait();
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    return status;
  }

 private:
  static constexpr std::chrono::milliseconds kPoll{50};
  grpc::ClientContext& context_;
  const std::function<bool()> goes_on_;
  bool is_cancelled_ = false;
  std::exception_ptr thrown_;
  grpc::CompletionQueue queue_;
};

}  // namespace palpate::client
