// Poses, message by message, for whoever waits for them: a script, a log. Programs that draw
// follow them with Client.
//
// Threads: one at a time. Ownership: the reader borrows the Calls that it came from.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>

#include "client/sdk/pose.h"

namespace palpate::client {

class Link;

class PoseReader {
 public:
  // See Calls::ReadPoses.
  PoseReader(Link& link, double rate_hz, std::uint32_t batch);
  ~PoseReader();
  PoseReader(PoseReader&&) noexcept;
  PoseReader& operator=(PoseReader&&) noexcept;

  // The next message within `timeout`; none: nothing came. Samples are fresh however slow the
  // caller is: what it cannot take is dropped at the daemon, and counted in `dropped`.
  // Errors: kUnavailable where the daemon went away, kPermissionDenied, kCancelled after
  // Calls::EndCalls, kInvalidArgument for a rate or a batch out of range.
  std::optional<PoseBatch> Next(std::chrono::milliseconds timeout);

 private:
  struct Call;
  Link* link_;
  std::unique_ptr<Call> call_;
};

}  // namespace palpate::client
