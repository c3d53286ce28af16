// One call of a two-way stream whose messages are acknowledged one by one. Request is a oneof of
// `start` and `acknowledgement`. Response has a message_number.
//
// `start` limits how many messages may be on their way. So messages are fresh, however slow the
// caller is.
//
// Threads: one. Ownership: the destructor ends the call.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <utility>

namespace palpate::client {

enum class CallEvent {
  kMessage,
  kTimeout,
  kEnded,  // ended by the other side; see status()
};

template <class Request, class Response>
class AcknowledgedCall {
 public:
  // `prepare(context, queue)` starts the call, for example with a stub's PrepareAsyncStreamVolume.
  // The stub must outlive the call.
  template <class Prepare>
  AcknowledgedCall(Request start, const Prepare& prepare)
      : start_(std::move(start)), call_(prepare(&context_, &queue_)) {
    call_->StartCall(Tag(kStart));
  }
  ~AcknowledgedCall() {
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
  AcknowledgedCall(const AcknowledgedCall&) = delete;
  AcknowledgedCall& operator=(const AcknowledgedCall&) = delete;

  // Waits for a message. The next call of Next acknowledges the message.
  CallEvent Next(std::chrono::milliseconds timeout, Response& message) {
    if (ended_) {
      return CallEvent::kEnded;
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
        // A message could not be read, and the other side waits for its acknowledgement.
        if (finishing_ && std::chrono::steady_clock::now() > finishing_since_ + kStatusPatience) {
          unreadable_ = true;
          context_.TryCancel();
        }
        return CallEvent::kTimeout;
      }
      Proceed(static_cast<Step>(reinterpret_cast<std::intptr_t>(tag)), ok);
      if (ended_) {
        return CallEvent::kEnded;
      }
      if (has_message_) {
        delivered_number_ = received_.message_number();
        message.Swap(&received_);
        return CallEvent::kMessage;
      }
    }
  }

  // The status of an ended call.
  const grpc::Status& status() const { return status_; }

 private:
  // The status of an ended call comes with its end.
  static constexpr std::chrono::seconds kStatusPatience{1};

  enum Step : std::intptr_t { kStart = 1, kRead, kWrite, kFinish };

  static void* Tag(std::intptr_t step) { return reinterpret_cast<void*>(step); }

  void Proceed(Step step, bool ok) {
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
        // The newest acknowledgement also acknowledges all messages before.
        if (ok && !finishing_ && acknowledged_number_ != taken_number_) {
          acknowledged_number_ = taken_number_;
          Request request;
          request.mutable_acknowledgement()->set_message_number(taken_number_);
          Write(request);
        }
        break;
      case kFinish:
        ended_ = true;
        if (unreadable_ && status_.error_code() == grpc::StatusCode::CANCELLED) {
          status_ = {grpc::StatusCode::INTERNAL, "a message cannot be read"};
        }
        break;
    }
  }

  void Read() {
    reading_ = true;
    call_->Read(&received_, Tag(kRead));
  }

  void Write(const Request& request) {
    writing_ = true;
    call_->Write(request, Tag(kWrite));
  }

  void Finish() {
    if (!finishing_) {
      finishing_ = true;
      finishing_since_ = std::chrono::steady_clock::now();
      call_->Finish(&status_, Tag(kFinish));
    }
  }

  Request start_;
  Response received_;
  std::uint64_t delivered_number_ = 0;
  std::uint64_t taken_number_ = 0;
  std::uint64_t acknowledged_number_ = 0;
  bool has_message_ = false;
  bool started_ = false;
  bool reading_ = false;
  bool writing_ = false;
  bool finishing_ = false;
  std::chrono::steady_clock::time_point finishing_since_;
  bool unreadable_ = false;
  bool ended_ = false;
  grpc::Status status_;

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::ClientAsyncReaderWriter<Request, Response>> call_;
};

}  // namespace palpate::client
