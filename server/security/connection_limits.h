// Decides which connections of strangers to cut off.
//
// A stranger's connection is one over TLS that has not yet made a call that it may make.
// gRPC 1.51 keeps all headers and messages that a connection sends without an end, before
// anybody is asked who calls and beyond gRPC's own quotas. A stranger needs a handshake and
// one first call, of little more than 3 MiB at most.
//
// Connections count by their prefix: an IPv6 host has a /64 to itself, and with it more
// addresses than there are places. A prefix that has most loses first.
//
// Between equal prefixes the oldest connection goes. An honest client makes its first call
// within about a second, and is no stranger then. If the youngest went, an attacker with as many
// prefixes as there are places would keep everybody out by holding idle connections. As it is,
// the attacker has to open as many connections anew as there are places, in the time of each
// honest handshake.
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

struct BoundedConnection {
  std::string prefix;
  std::int64_t bytes = 0;
};

struct ConnectionCut {
  std::size_t connection = 0;  // index
  bool sent_too_much = false;  // else: too many of them
};

// `connections`: the oldest first. The rest keeps within all three bounds.
std::vector<ConnectionCut> CutsAmong(std::span<const BoundedConnection> connections,
                                     const ConnectionBounds& bounds);

// What an address counts under: "10.0.0.7", also where it came as IPv4 in IPv6, or
// "2001:db8:0:1::/64".
std::string PrefixOf(const sockaddr_storage& address);

}  // namespace palpate
