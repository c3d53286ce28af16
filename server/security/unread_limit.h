// Bounds the answers that a connection leaves unread: they take memory until the client reads them.
//
// A connection that stays above the bound gets no further call until its client has read; at once
// if all connections together are above theirs. Refusals count as well, and end the connection of a
// client that goes on calling. Clients on the socket are not bounded: gRPC names
// all of them alike, and who may open the socket is trusted.
// Threads: any.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace palpate {

class UnreadLimit {
 public:
  // What gRPC 1.51 keeps for a call, besides its answer: 17 KB were seen.
  static constexpr std::size_t kCallBytes = 16 << 10;
  static constexpr std::size_t kMostBytes = 48 << 10;
  static constexpr std::size_t kMostRefusals = 32;
  static constexpr std::size_t kMostBytesOfAll = std::size_t{64} << 20;
  // The answers to many calls at once are above the bound, too, until gRPC has sent them.
  static constexpr std::int64_t kPatienceNs = 1'000'000'000;

  bool IsAbove(const std::string& peer, std::int64_t now_ns) const {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(peer);
    return found != unread_.end() && found->second.bytes >= kMostBytes &&
           (bytes_of_all_ > kMostBytesOfAll || now_ns - found->second.above_since_ns > kPatienceNs);
  }
  // Its client goes on calling and does not even read refusals: the connection must end.
  bool IsDeaf(const std::string& peer, std::int64_t now_ns) const {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(peer);
    if (found == unread_.end()) return false;
    const Unread& unread = found->second;
    if (bytes_of_all_ > kMostBytesOfAll) return unread.refusals >= kMostRefusals / 4;
    return unread.refusals >= kMostRefusals && now_ns - unread.deaf_since_ns > kPatienceNs;
  }
  // An answer, or a refusal, waits for its client. Afterwards give the same to Sent.
  void Waits(const std::string& peer, std::size_t answer_bytes, std::int64_t now_ns,
             bool is_refusal = false) {
    if (peer.starts_with("unix:")) return;
    const std::lock_guard lock(mutex_);
    Unread& unread = unread_[peer];
    if (unread.bytes < kMostBytes) unread.above_since_ns = now_ns;
    unread.bytes += kCallBytes + answer_bytes;
    if (unread.refusals < kMostRefusals) unread.deaf_since_ns = now_ns;
    unread.refusals += is_refusal;
    bytes_of_all_ += kCallBytes + answer_bytes;
  }
  void Sent(const std::string& peer, std::size_t answer_bytes, bool is_refusal = false) {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(peer);
    if (found == unread_.end()) return;
    found->second.bytes -= kCallBytes + answer_bytes;
    found->second.refusals -= is_refusal;
    bytes_of_all_ -= kCallBytes + answer_bytes;
    if (found->second.bytes == 0) unread_.erase(found);
  }

 private:
  struct Unread {
    std::size_t bytes = 0;
    std::size_t refusals = 0;
    std::int64_t above_since_ns = 0;  // while it is above the bound
    std::int64_t deaf_since_ns = 0;   // while it has too many refusals
  };

  mutable std::mutex mutex_;
  std::map<std::string, Unread> unread_;  // by peer; none without bytes
  std::size_t bytes_of_all_ = 0;
};

}  // namespace palpate
