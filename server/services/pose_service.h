// PoseService: streams of ticks to any number of subscribers.
//
// Each stream is a reactor with at most one write in progress. The pump thread adds samples and may
// start a write. gRPC's threads finish writes and deliver acknowledgements. No thread blocks here.
// Ownership: the pump holds streams by weak_ptr. A stream holds itself until gRPC has finished with
// it.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "palpate/v1/pose.grpc.pb.h"
#include "palpate/v1/pose.pb.h"
#include "server/door/access.h"
#include "server/metrics/service_metrics.h"
#include "server/pump/pump.h"
#include "server/pump/tick_sample.h"

namespace palpate {

// Throws Error (kInvalidArgument) for values out of range.
struct PoseStreamOptions {
  std::uint64_t ticks_per_sample = 1;
  std::size_t batch = 1;
  std::optional<std::uint64_t> max_unacknowledged;
  std::size_t waiting = 1;  // samples, at least a batch
};
PoseStreamOptions ParsePoseStreamOptions(const v1::StreamPosesStart& start);

// The samples per second that the stream takes from the budget of all streams, rounded up.
int SamplesPerSecond(const PoseStreamOptions& options);

// The messages for one subscriber of poses, without the transport: decimation, batches, dropping
// the oldest samples, and the window of unacknowledged messages.
//
// Threads: one at a time (the caller locks). Not real-time: it may allocate.
class PoseStream {
 public:
  explicit PoseStream(const PoseStreamOptions& options) : options_(options) {}

  // Takes the sample if it is due. If too many still wait, drops the oldest and counts it.
  void Add(const TickSample& sample);
  void Acknowledge(std::uint64_t message_number);

  // True if a full batch waits and the window has room.
  bool HasMessage() const;
  // Takes the oldest batch into a message.
  v1::StreamPosesResponse TakeMessage(std::int64_t now_ns);

 private:
  PoseStreamOptions options_;
  std::deque<TickSample> waiting_;
  std::optional<std::uint64_t> next_tick_;  // loop time: ticks plus missed ticks
  std::uint64_t dropped_ = 0;
  std::uint64_t sent_ = 0;
  std::uint64_t acknowledged_ = 0;
};

class PoseService final : public v1::PoseService::CallbackService {
 public:
  PoseService(Access& access, Pump& pump, ServiceMetrics& metrics)
      : access_(access), pump_(pump), metrics_(metrics) {}

  grpc::ServerBidiReactor<v1::StreamPosesRequest, v1::StreamPosesResponse>* StreamPoses(
      grpc::CallbackServerContext* context) override;

 private:
  Access& access_;
  Pump& pump_;
  ServiceMetrics& metrics_;
};

}  // namespace palpate
