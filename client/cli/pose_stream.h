// A subscription to PoseService, acknowledged message by message.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdint>
#include <memory>

#include "client/cli/connection.h"
#include "palpate/v1/pose.grpc.pb.h"

namespace palpate::cli {

// At most four messages are on their way to us, so that samples are fresh
// however slow the reader of our output is; what it cannot take is dropped at
// the server.
//
// Threads: one. Ownership: borrows nothing; ends the call in its destructor.
class PoseStream {
 public:
  enum class Event {
    kMessage,
    kTimeout,
    kEnded,  // by the other side; see status()
  };

  // `rate_hz` in (0, 1000] and `batch` in 1 to 256, as in StreamPosesStart.
  PoseStream(const Connection& connection, double rate_hz, std::uint32_t batch);
  ~PoseStream();
  PoseStream(const PoseStream&) = delete;
  PoseStream& operator=(const PoseStream&) = delete;

  // Waits for a message; the call after acknowledges it.
  Event Next(std::chrono::milliseconds timeout, v1::StreamPosesResponse& message);

  // Of an ended stream.
  const grpc::Status& status() const { return status_; }

 private:
  enum Step : std::intptr_t { kStart = 1, kRead, kWrite, kFinish };

  void Proceed(Step step, bool ok);
  void Read();
  void Write(const v1::StreamPosesRequest& request);
  void Finish();

  v1::StreamPosesRequest start_;
  v1::StreamPosesResponse received_;
  std::uint64_t taken_number_ = 0;
  std::uint64_t acknowledged_number_ = 0;
  bool has_message_ = false;
  bool started_ = false;
  bool reading_ = false;
  bool writing_ = false;
  bool finishing_ = false;
  bool ended_ = false;
  grpc::Status status_;

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<v1::PoseService::Stub> stub_;
  std::unique_ptr<grpc::ClientAsyncReaderWriter<v1::StreamPosesRequest, v1::StreamPosesResponse>>
      call_;
};

}  // namespace palpate::cli
