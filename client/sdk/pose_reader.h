// Reads poses message by message, for programs that wait for them: a script, a log. Programs that
// draw use Client instead.
//
// Threads: one at a time. Ownership: borrows the Calls that made it.
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

  // Returns the next message, or none after `timeout`. Samples are fresh however slow the caller
  // is: the daemon drops what the caller cannot take, and counts it in `dropped`.
  // Errors: kUnavailable (the daemon went away), kPermissionDenied, kCancelled (Calls::EndCalls),
  // kInvalidArgument (rate or batch out of range).
  std::optional<PoseBatch> Next(std::chrono::milliseconds timeout);

 private:
  struct Call;
  Link* link_;
  std::unique_ptr<Call> call_;
};

}  // namespace palpate::client
