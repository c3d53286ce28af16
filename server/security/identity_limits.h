// How much each identity may have of the daemon at once.
//
// Threads: any.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/security/methods.h"
#include "server/security/rate_limit.h"

namespace palpate {

// Per identity. All who come over one socket are one identity.
struct LimitOptions {
  int calls_per_s = 2000;  // as many at once
  int pose_streams = 256;
  // Of all identities together; one over the network has half of it at most, so that none
  // keeps the others out. A message costs 9 to 20 us: 64 streams at 1 kHz do not fit two
  // cores, and the thread that carries samples falls behind.
  int pose_samples_per_s = 32'000;
  int volume_streams = 64;
  int transfers = 8;
};

class IdentityLimits {
 public:
  explicit IdentityLimits(const LimitOptions& options) : options_(options) {}

  // Takes one of `kind`; a problem and what to do where there are too many. Streams and
  // transfers are given back with Leave.
  std::optional<std::string> Enter(const std::string& identity, CallKind kind, std::int64_t now_ns);
  void Leave(const std::string& identity, CallKind kind);

  // The same of the samples per second that a stream of poses asks for. `is_local`: on the
  // socket.
  std::optional<std::string> EnterSamples(const std::string& identity, bool is_local,
                                          int samples_per_s);
  void LeaveSamples(const std::string& identity, int samples_per_s);

 private:
  struct Use {
    RateLimit calls;
    std::array<int, 5> running{};  // by kind
    int samples_per_s = 0;
  };

  Use& UseOf(const std::string& identity);

  const LimitOptions options_;
  std::mutex mutex_;
  std::map<std::string, Use> uses_;  // of identities that the configuration names: few
  int samples_per_s_ = 0;            // of all
};

}  // namespace palpate
