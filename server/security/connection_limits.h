// What the connections of strangers and viewers may cost, and which of too many strangers goes.
//
// A stranger's connection is a TLS connection that has not yet made an allowed call, or whose
// client is no longer allowed. gRPC 1.51 keeps all unfinished headers and messages of a connection,
// before anybody checks the caller, and even beyond gRPC's own quotas. An honest stranger needs
// only a handshake and a small first call.
//
// Connections are counted by prefix: an IPv6 host has a /64 to itself, and so more addresses than
// the limit allows connections. The prefix with the most loses first.
//
// Among equal prefixes, the oldest connection is cut off. An honest client makes its first call
// within about a second and is then no stranger. If the youngest connection were cut off, an
// attacker with as many prefixes as the limit could keep everybody out by holding idle connections.
// With this rule, the attacker must open as many new connections as the limit during each honest
// handshake.
//
// Pure. Lengths are bytes of TLS over TCP.
#pragma once

#include <sys/socket.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <vector>

namespace palpate {

inline constexpr std::size_t kMostStrangers = 64;

// What strangers, and known clients who may only watch, send for nothing: beyond kBytesPerCall for
// each call that is admitted, kBytesPerSample for each sample of poses that they take, and a share
// of the voxels. gRPC works hardest for small frames that lead to no call. It needs 90 µs for a
// call that is begun and reset at once, which takes 29 bytes: four connections that sent 50 KiB/s
// of them kept everybody else out for 15 s.
inline constexpr std::int64_t kBytesPerCall = 256;
inline constexpr std::int64_t kBytesPerSample = 128;
inline constexpr std::int64_t kVoxelBytesPerByte = 512;
inline constexpr std::int64_t kIdleBytesOfOne = 128 << 10;
inline constexpr std::int64_t kIdleBytesOfAll = 192 << 10;
// So much of it is forgotten each second.
inline constexpr std::int64_t kIdleBytesOfOnePerS = 16 << 10;
inline constexpr std::int64_t kIdleBytesOfAllPerS = 64 << 10;
// A connection with less is not cut off for what all have sent together.
inline constexpr std::int64_t kLittleIdleBytes = 6 << 10;

// Returns which of the connections to cut off, by their prefixes, the oldest connection first. At
// most `most` remain.
std::vector<std::size_t> CutsAmong(std::span<const std::string> prefixes,
                                   std::size_t most = kMostStrangers);

// The prefix that an address counts for: "10.0.0.7" (also for IPv4 in IPv6), or
// "2001:db8:0:1::/64".
std::string PrefixOf(const sockaddr_storage& address);

// Bounds the answers that a connection leaves unread: they take memory until the client reads them.
//
// A connection that stays above the bound gets no further call until its client has read; at once
// if all connections together are above theirs. Refusals count as well, and end the TCP connection
// of a client that goes on calling. gRPC names all clients of a socket alike, and those of a door
// come on any connection: they have one bound together, at once, and calls whose answers they do
// not read end (Access).
//
// `who`: a connection as gRPC names it, or any other name for those who have a bound together.
// Empty: a client that is trusted, and has no bound.
class UnreadLimit {
 public:
  // What gRPC 1.51 keeps for a call, besides its answer: 17 KB were seen.
  static constexpr std::size_t kCallBytes = 16 << 10;
  static constexpr std::size_t kMostBytes = 48 << 10;
  static constexpr std::size_t kMostBytesOfMany = std::size_t{16} << 20;
  static constexpr std::size_t kMostRefusals = 32;
  static constexpr std::size_t kMostBytesOfAll = std::size_t{64} << 20;
  // The answers to many calls at once are above the bound, too, until gRPC has sent them.
  static constexpr std::int64_t kPatienceNs = 1'000'000'000;

  bool IsAbove(const std::string& who, std::int64_t now_ns) const {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(who);
    if (found == unread_.end()) return false;
    if (!IsConnection(who)) return found->second.bytes >= kMostBytesOfMany;
    return found->second.bytes >= kMostBytes &&
           (bytes_of_all_ > kMostBytesOfAll || now_ns - found->second.above_since_ns > kPatienceNs);
  }
  // Its client goes on calling and does not even read refusals: the connection must end.
  bool IsDeaf(const std::string& who, std::int64_t now_ns) const {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(who);
    if (found == unread_.end()) return false;
    const Unread& unread = found->second;
    if (bytes_of_all_ > kMostBytesOfAll) return unread.refusals >= kMostRefusals / 4;
    return unread.refusals >= kMostRefusals && now_ns - unread.deaf_since_ns > kPatienceNs;
  }
  // An answer, or a refusal, waits for its client. Afterwards give the same to Sent.
  void Waits(const std::string& who, std::size_t answer_bytes, std::int64_t now_ns,
             bool is_refusal = false) {
    if (who.empty()) return;
    const std::lock_guard lock(mutex_);
    Unread& unread = unread_[who];
    if (unread.bytes < kMostBytes) unread.above_since_ns = now_ns;
    unread.bytes += kCallBytes + answer_bytes;
    if (unread.refusals < kMostRefusals) unread.deaf_since_ns = now_ns;
    unread.refusals += is_refusal;
    if (IsConnection(who)) bytes_of_all_ += kCallBytes + answer_bytes;
  }
  void Sent(const std::string& who, std::size_t answer_bytes, bool is_refusal = false) {
    const std::lock_guard lock(mutex_);
    const auto found = unread_.find(who);
    if (found == unread_.end()) return;
    found->second.bytes -= kCallBytes + answer_bytes;
    found->second.refusals -= is_refusal;
    if (IsConnection(who)) bytes_of_all_ -= kCallBytes + answer_bytes;
    if (found->second.bytes == 0) unread_.erase(found);
  }

 private:
  struct Unread {
    std::size_t bytes = 0;
    std::size_t refusals = 0;
    std::int64_t above_since_ns = 0;  // while it is above the bound
    std::int64_t deaf_since_ns = 0;   // while it has too many refusals
  };

  // As gRPC names one.
  static bool IsConnection(const std::string& who) {
    return who.starts_with("ipv4:") || who.starts_with("ipv6:");
  }

  mutable std::mutex mutex_;
  std::map<std::string, Unread> unread_;  // none without bytes
  std::size_t bytes_of_all_ = 0;          // of connections
};

}  // namespace palpate
