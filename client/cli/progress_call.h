// Calls whose answers are progress and, at the end, one result.
//
// Threads: main only.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "client/cli/connection.h"
#include "client/cli/interrupt.h"
#include "palpate/v1/volume.pb.h"

namespace palpate::cli {

// On stderr: on a terminal a bar in place; else a line per stage and per quarter.
class ProgressPrinter {
 public:
  ProgressPrinter();
  ~ProgressPrinter();
  ProgressPrinter(const ProgressPrinter&) = delete;
  ProgressPrinter& operator=(const ProgressPrinter&) = delete;

  void Print(const v1::LoadVolumeProgress& progress);

 private:
  const bool is_terminal_;
  bool bar_drawn_ = false;
  std::string stage_;
  int quarter_ = -1;
};

// A call of the server's stream, one step at a time, so that a signal can cancel it
// between two.
template <class Response>
class ProgressCall {
 public:
  using Reader = grpc::ClientAsyncReader<Response>;

  // `prepare(context, queue)`: such as a stub's PrepareAsyncLoadVolume.
  template <class Prepare>
  explicit ProgressCall(const Prepare& prepare) : call_(prepare(&context_, &queue_)) {
    call_->StartCall(this);
    Wait();
  }

  ~ProgressCall() {
    // A call that is abandoned, because our output broke, must end too.
    if (!finished_) {
      context_.TryCancel();
      Finish();
    }
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  ProgressCall(const ProgressCall&) = delete;
  ProgressCall& operator=(const ProgressCall&) = delete;

  bool Read(Response& response) {
    call_->Read(&response, this);
    return Wait();
  }

  grpc::Status Finish() {
    grpc::Status status;
    call_->Finish(&status, this);
    Wait();
    finished_ = true;
    return status;
  }

 private:
  bool Wait() {
    constexpr std::chrono::milliseconds kInterruptPoll(50);
    void* tag = nullptr;
    bool ok = false;
    while (queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kInterruptPoll) ==
           grpc::CompletionQueue::TIMEOUT) {
      if (Interrupt::IsRaised()) {
        context_.TryCancel();
      }
    }
    return ok;
  }

  bool finished_ = false;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<Reader> call_;
};

// Runs such a call to its end and shows its progress; Ctrl-C and SIGTERM cancel it.
// Response: a oneof of `progress` and `result`. `cancelled`: what to say then.
// Errors: as Connection::ErrorOf; kCancelled.
template <class Response, class Prepare>
auto RunWithProgress(const Connection& connection, const Prepare& prepare,
                     const std::string& cancelled) {
  const Interrupt interrupt;
  ProgressPrinter printer;
  ProgressCall<Response> call(prepare);
  std::optional<std::decay_t<decltype(std::declval<Response>().result())>> result;
  Response response;
  while (call.Read(response)) {
    if (response.has_progress()) {
      printer.Print(response.progress());
    } else if (response.has_result()) {
      result = response.result();
    }
  }
  const grpc::Status status = call.Finish();
  if (status.ok() && !result) {
    throw Error(ErrorKind::kInternal, "palpated ended the call without a result");
  }
  if (!status.ok() && Interrupt::IsRaised()) {
    throw Error(ErrorKind::kCancelled, cancelled);
  }
  if (!status.ok()) {
    throw connection.ErrorOf(status);
  }
  return *result;
}

}  // namespace palpate::cli
