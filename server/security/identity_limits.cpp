#include "server/security/identity_limits.h"

#include <algorithm>

namespace palpate {
namespace {

std::string TooMany(int most, const std::string& what, const std::string& key) {
  return std::to_string(most) + " " + what +
         " are the most for one client: end some, or raise limits." + key;
}

std::string TooManySamples(int asked, int most, int taken, const std::string& whose) {
  return std::to_string(asked) + " samples per second cannot be added: " + std::to_string(taken) +
         " of the " + std::to_string(most) + " for " + whose +
         " are taken; ask for a lower rate, end other streams of poses, or raise "
         "limits.pose_samples_per_s";
}

}  // namespace

std::optional<std::string> IdentityLimits::Enter(const std::string& identity, CallKind kind,
                                                 std::size_t request_bytes, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  Use& use = UseOf(identity);
  int& running = use.running[static_cast<std::size_t>(kind)];
  const bool is_call = kind == CallKind::kCall || kind == CallKind::kQuestion;
  if (is_call && !use.calls.Take(now_ns)) {
    return std::to_string(options_.calls_per_s) +
           " calls per second are the most for one client: call less often, or raise "
           "limits.calls_per_s";
  }
  if (kind == CallKind::kQuestion) {
    if (auto problem = WorkProblem(use, now_ns)) return problem;
  }
  if (request_bytes > kMostRequestBytes - use.request_bytes) {
    return std::to_string(kMostRequestBytes >> 20) +
           " MiB of requests at a time are the most for one client: wait for answers before you "
           "go on";
  }
  const bool is_fact_stream = kind == CallKind::kFactStream;
  if ((kind == CallKind::kPoseStream || is_fact_stream) && running >= options_.pose_streams) {
    return TooMany(options_.pose_streams, is_fact_stream ? "streams of facts" : "streams of poses",
                   "pose_streams");
  }
  if (kind == CallKind::kVolumeStream && running >= options_.volume_streams) {
    return TooMany(options_.volume_streams, "streams of the volume", "volume_streams");
  }
  if (kind == CallKind::kTransfer && running >= options_.transfers) {
    return TooMany(options_.transfers, "loads, saves, uploads and replays", "transfers");
  }
  if (kind == CallKind::kHand && running >= kMostHands) {
    return std::to_string(kMostHands) +
           " calls that lead the hand are the most for one client: end some";
  }
  ++running;
  use.request_bytes += request_bytes;
  return std::nullopt;
}

double IdentityLimits::WorkOf(Use& use, std::int64_t now_ns) {
  const double passed_s = 1e-9 * static_cast<double>(now_ns - use.work_ns);
  use.work_s = std::max(0.0, use.work_s - kWorkShare * std::max(0.0, passed_s));
  use.work_ns = now_ns;
  return use.work_s;
}

std::optional<std::string> IdentityLimits::WorkProblem(Use& use, std::int64_t now_ns) {
  if (WorkOf(use, now_ns) < kMostWorkS) return std::nullopt;
  return "questions of one client may take a quarter of a processor: ask less often";
}

std::optional<std::string> IdentityLimits::MayWork(const std::string& identity,
                                                   std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  return WorkProblem(UseOf(identity), now_ns);
}

void IdentityLimits::Worked(const std::string& identity, double seconds, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  Use& use = UseOf(identity);
  use.work_s = std::min(WorkOf(use, now_ns) + seconds, kMostDebtS);
}

IdentityLimits::Use& IdentityLimits::UseOf(const std::string& identity) {
  const RateLimit full(options_.calls_per_s, options_.calls_per_s);
  return uses_.try_emplace(identity, Use{.calls = full}).first->second;
}

std::optional<std::string> IdentityLimits::EnterSamples(const std::string& identity,
                                                        bool is_preferred, int samples_per_s) {
  const std::lock_guard lock(mutex_);
  Use& use = UseOf(identity);
  const int most = options_.pose_samples_per_s;
  const int most_of_one = is_preferred ? most : most / 2;
  if (use.samples_per_s + samples_per_s > most_of_one) {
    return TooManySamples(samples_per_s, most_of_one, use.samples_per_s,
                          is_preferred
                              ? "the clients on this socket"
                              : "one client over the network, or on a lower role's socket");
  }
  if (!is_preferred && samples_per_s_ + samples_per_s > most) {
    return TooManySamples(samples_per_s, most, samples_per_s_, "all clients together");
  }
  use.samples_per_s += samples_per_s;
  samples_per_s_ += samples_per_s;
  return std::nullopt;
}

void IdentityLimits::LeaveSamples(const std::string& identity, int samples_per_s) {
  const std::lock_guard lock(mutex_);
  UseOf(identity).samples_per_s -= samples_per_s;
  samples_per_s_ -= samples_per_s;
}

void IdentityLimits::Leave(const std::string& identity, CallKind kind, std::size_t request_bytes) {
  const std::lock_guard lock(mutex_);
  Use& use = UseOf(identity);
  --use.running[static_cast<std::size_t>(kind)];
  use.request_bytes -= request_bytes;
}

}  // namespace palpate
