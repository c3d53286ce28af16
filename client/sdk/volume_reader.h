// Keeps a VolumeMirror equal to the daemon's volume. It reads the stream, acknowledges what it
// took, and resumes after a loss.
//
// Threads: one at a time. Only Next touches the mirror. Ownership: borrows the mirror, shares the
// channel.
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
  // The most messages on their way, 1 to 64.
  std::uint32_t max_unacknowledged = 4;
  // The pause after a loss. It doubles with every loss in a row, up to longest_pause.
  std::chrono::milliseconds first_pause{100};
  std::chrono::milliseconds longest_pause{5000};
};

class VolumeReader {
 public:
  enum class Event {
    kApplied,   // a message went into the mirror
    kComplete,  // as kApplied, and the mirror is complete
    kTimeout,   // nothing came
    kLost,      // the stream was lost, see last_loss(); the reader tries again
  };

  VolumeReader(std::shared_ptr<grpc::Channel> channel, VolumeMirror& mirror,
               const VolumeReaderOptions& options = {});
  ~VolumeReader();
  VolumeReader(const VolumeReader&) = delete;
  VolumeReader& operator=(const VolumeReader&) = delete;

  // Returns the next event within `timeout`. Errors: an Error that a retry does not mend: no
  // permission, another version, a copy that is damaged again and again.
  Event Next(std::chrono::milliseconds timeout);

  // None before the first loss.
  const std::optional<Error>& last_loss() const { return last_loss_; }
  // True if it was lost because palpated loads its first volume.
  bool is_loading() const { return last_loss_ && last_loss_->kind() == ErrorKind::kLoading; }
  // Losses in a row, with no message in between.
  int losses_in_a_row() const { return losses_in_a_row_; }
  std::uint64_t losses() const { return losses_; }
  // Bytes of all messages so far, without the transport's frames.
  std::uint64_t bytes_received() const { return bytes_received_; }

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
};

}  // namespace palpate::client
