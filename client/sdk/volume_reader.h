// Keeps a VolumeMirror equal to the daemon's volume: reads the stream, acknowledges
// what was taken, and after a loss comes back and resumes.
//
// Threads: one at a time, the one that calls Next; the mirror is touched in Next
// only. Ownership: borrows the mirror, shares the channel.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>

#include "client/sdk/volume_mirror.h"
#include "common/error/error.h"

namespace grpc {
class Channel;
class Status;
}  // namespace grpc

namespace palpate::client {

class VolumeCall;

struct VolumeReaderOptions {
  // Messages on their way at most, 1 to 64.
  std::uint32_t max_unacknowledged = 4;
  // Pause after a loss; doubled by every loss without a message between, up to the
  // longest.
  std::chrono::milliseconds first_pause{100};
  std::chrono::milliseconds longest_pause{5000};
};

class VolumeReader {
 public:
  enum class Event {
    kApplied,   // a message went into the mirror
    kComplete,  // the same, and the mirror is complete
    kTimeout,   // nothing came
    kLost,      // the stream was lost, see last_loss(); it is tried again
  };

  VolumeReader(std::shared_ptr<grpc::Channel> channel, VolumeMirror& mirror,
               const VolumeReaderOptions& options = {});
  ~VolumeReader();
  VolumeReader(const VolumeReader&) = delete;
  VolumeReader& operator=(const VolumeReader&) = delete;

  // The next event within `timeout`. Errors: Error for what trying again does not
  // mend: no permission, another version, a copy that is damaged again and again.
  Event Next(std::chrono::milliseconds timeout);

  // None before the first.
  const std::optional<Error>& last_loss() const { return last_loss_; }
  // Losses without a message between.
  int losses_in_a_row() const { return losses_in_a_row_; }
  std::uint64_t losses() const { return losses_; }
  // Of all messages so far, as they travel: without the transport's frames.
  std::uint64_t bytes_received() const { return bytes_received_; }
  std::uint64_t messages_received() const { return messages_received_; }

 private:
  using Clock = std::chrono::steady_clock;

  Event Lose(const Error& error);
  Event End(const grpc::Status& status);

  std::shared_ptr<grpc::Channel> channel_;
  VolumeMirror& mirror_;
  VolumeReaderOptions options_;
  std::unique_ptr<VolumeCall> call_;
  Clock::time_point try_again_{};
  std::optional<Error> last_loss_;
  int losses_in_a_row_ = 0;
  int damaged_in_a_row_ = 0;
  std::uint64_t losses_ = 0;
  std::uint64_t bytes_received_ = 0;
  std::uint64_t messages_received_ = 0;
};

}  // namespace palpate::client
