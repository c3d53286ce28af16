// The messages for one subscriber of poses, without the transport: decimation, batches, dropping
// the oldest samples, and the window of unacknowledged messages.
//
// Threads: one at a time (the caller locks). Not real-time: it may allocate.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "palpate/v1/pose.pb.h"
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

}  // namespace palpate
