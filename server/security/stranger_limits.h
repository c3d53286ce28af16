// Whom of those that have not yet made a call that they may make to cut off: gRPC 1.51
// keeps all that a connection sends in headers without an end, and in messages without an
// end, before it asks who calls.
//
// A client sends its token with its first call, of 4 MiB at most; so that more than that,
// and the handshake, is nobody's. Many connections of one address go before the few of
// another.
//
// Pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace palpate {

inline constexpr std::size_t kMostStrangers = 64;
inline constexpr std::int64_t kMostBytesOfStranger = std::int64_t{8} << 20;
inline constexpr std::int64_t kMostBytesOfStrangers = std::int64_t{64} << 20;

struct StrangerConnection {
  std::string address;
  std::int64_t received_bytes = 0;
};

struct StrangerCut {
  std::size_t connection = 0;  // index
  bool sent_too_much = false;  // else: too many of them
};

// `strangers`: in the order in which they came. The rest keeps within all three bounds.
std::vector<StrangerCut> CutsAmongStrangers(std::span<const StrangerConnection> strangers);

}  // namespace palpate
