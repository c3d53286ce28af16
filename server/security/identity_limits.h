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

 private:
  struct Use {
    RateLimit calls;
    std::array<int, 5> running{};  // by kind
  };

  const LimitOptions options_;
  std::mutex mutex_;
  std::map<std::string, Use> uses_;  // of identities that the configuration names: few
};

}  // namespace palpate
