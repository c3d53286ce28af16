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

}  // namespace palpate
