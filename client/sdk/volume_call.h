// One call of VolumeService.StreamVolume, acknowledged message by message.
//
// Threads: one. Ownership: borrows nothing; ends the call in its destructor.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/bricks/volume_event.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate {

class VolumeCall {
 public:
  enum class Event {
    kMessage,
    kTimeout,
    kEnded,  // by the other side; see status()
  };

  VolumeCall(const std::shared_ptr<grpc::Channel>& channel, std::uint32_t max_unacknowledged,
             const std::optional<VolumeRevision>& resume_from);
  ~VolumeCall();
  VolumeCall(const VolumeCall&) = delete;
  VolumeCall& operator=(const VolumeCall&) = delete;

  // Waits for a message; the call after acknowledges it.
  Event Next(std::chrono::milliseconds timeout, v1::StreamVolumeResponse& message);

  // Of an ended call.
  const grpc::Status& status() const { return status_; }

 private:
  enum Step : std::intptr_t { kStart = 1, kRead, kWrite, kFinish };

  void Proceed(Step step, bool ok);
  void Read();
  void Write(const v1::StreamVolumeRequest& request);
  void Finish();

  v1::StreamVolumeRequest start_;
  v1::StreamVolumeResponse received_;
  std::uint64_t delivered_number_ = 0;
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
  std::unique_ptr<v1::VolumeService::Stub> stub_;
  std::unique_ptr<grpc::ClientAsyncReaderWriter<v1::StreamVolumeRequest, v1::StreamVolumeResponse>>
      call_;
};

}  // namespace palpate
