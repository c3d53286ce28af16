// Decides which connections of strangers to cut off.
//
// A stranger's connection is a TLS connection that has not yet made an allowed call, or whose
// client is no longer allowed. gRPC 1.51 keeps all unfinished headers and messages of a connection,
// before anybody checks the caller, and even beyond gRPC's own quotas. An honest stranger needs
// only a handshake and one first call of little more than 3 MiB.
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
#include <span>
#include <string>
#include <vector>

namespace palpate {

struct ConnectionBounds {
  std::size_t connections = 0;
  std::int64_t bytes_of_one = 0;
  std::int64_t bytes_of_all = 0;
};

inline constexpr ConnectionBounds kStrangerBounds{
    .connections = 64, .bytes_of_one = 8 << 20, .bytes_of_all = 64 << 20};

// What known clients who may only watch have sent lately. Their requests are small; the greatest
// message is 3 MiB.
inline constexpr ConnectionBounds kViewerBounds{
    .connections = SIZE_MAX, .bytes_of_one = 4 << 20, .bytes_of_all = 32 << 20};
// So much of it is forgotten each second.
inline constexpr std::int64_t kViewerBytesPerS = 1 << 20;

struct BoundedConnection {
  std::string prefix;
  std::int64_t bytes = 0;
};

struct ConnectionCut {
  std::size_t connection = 0;  // index
  bool sent_too_much = false;  // false: too many connections
};

// `connections`: the oldest first. The remaining connections are within all three bounds.
std::vector<ConnectionCut> CutsAmong(std::span<const BoundedConnection> connections,
                                     const ConnectionBounds& bounds);

// The prefix that an address counts for: "10.0.0.7" (also for IPv4 in IPv6), or
// "2001:db8:0:1::/64".
std::string PrefixOf(const sockaddr_storage& address);

}  // namespace palpate
