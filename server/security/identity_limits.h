// Limits how much of the daemon each identity may use at once.
//
// Threads: any.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/log/line_budget.h"
#include "server/security/methods.h"

namespace palpate {

// Limits per identity. All clients on one socket are one identity.
struct LimitOptions {
  int calls_per_s = 2000;  // also the most at once
  int pose_streams = 256;  // and as many of facts
  // For all identities together. One identity over the network may have at most half, so that no
  // identity keeps the others out. A message costs 9 to 20 us: 64 streams at 1 kHz are too much for
  // two cores, and the thread that carries samples falls behind.
  int pose_samples_per_s = 32'000;
  int volume_streams = 64;
  int transfers = 8;
  // An upload whose client sends less than 512 KiB in so much time ends.
  std::chrono::milliseconds send_patience{30'000};
};

class IdentityLimits {
 public:
  explicit IdentityLimits(const LimitOptions& options) : options_(options) {}

  // The requests of calls that one identity may have waiting; each at most 3 MiB.
  static constexpr std::size_t kMostRequestBytes = std::size_t{128} << 20;
  // The calls of one identity that lead the hand, or wait to hear that another one does.
  static constexpr int kMostHands = 8;

  // The processor time that the questions of one identity may take, of one processor, and at once.
  static constexpr double kWorkShare = 0.25;
  static constexpr double kMostWorkS = 0.5;
  static constexpr double kMostDebtS = 1.0;  // so a client is refused for two seconds at most

  // Takes one of `kind`, with a request of this length. If there are too many, returns the problem
  // and what to do. Give it back with Leave.
  std::optional<std::string> Enter(const std::string& identity, CallKind kind,
                                   std::size_t request_bytes, std::int64_t now_ns);
  // Ask it before the work of a question, as others may have worked while it waited.
  std::optional<std::string> MayWork(const std::string& identity, std::int64_t now_ns);
  // A question took so much processor time.
  void Worked(const std::string& identity, double seconds, std::int64_t now_ns);
  void Leave(const std::string& identity, CallKind kind, std::size_t request_bytes);

  // Takes samples per second for a stream of poses, in the same way. `is_preferred`: see
  // Entry.
  std::optional<std::string> EnterSamples(const std::string& identity, bool is_preferred,
                                          int samples_per_s);
  void LeaveSamples(const std::string& identity, int samples_per_s);

 private:
  struct Use {
    RateLimit calls;
    std::array<int, 8> running{};  // by kind
    std::size_t request_bytes = 0;
    int samples_per_s = 0;
    double work_s = 0.0;  // of questions, less what kWorkShare has allowed since
    std::int64_t work_ns = 0;
  };

  static double WorkOf(Use& use, std::int64_t now_ns);
  static std::optional<std::string> WorkProblem(Use& use, std::int64_t now_ns);
  Use& UseOf(const std::string& identity);

  const LimitOptions options_;
  std::mutex mutex_;
  std::map<std::string, Use> uses_;  // few: only identities that the configuration names
  int samples_per_s_ = 0;            // of all identities
};

}  // namespace palpate
