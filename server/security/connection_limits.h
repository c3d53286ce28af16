// Which connections to cut off: gRPC 1.51 keeps all that a connection sends in headers
// without an end, and in messages without an end, before anybody is asked and beyond its
// own quotas.
//
// A stranger, who has not yet made a call that he may make, sends his token with his first
// call, of 4 MiB at most: more than that, and the handshake, is nobody's. Of a known client
// counts what belongs to none of the calls and messages that were read: gRPC's windows hold
// what is under way below 16 MiB. Many connections of one address go
// before the few of another.
//
// Pure. Lengths are bytes of TLS over TCP.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
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
inline constexpr ConnectionBounds kKnownBounds{
    .connections = std::numeric_limits<std::size_t>::max(),
    .bytes_of_one = 32 << 20,
    .bytes_of_all = 256 << 20};

struct BoundedConnection {
  std::string address;
  std::int64_t bytes = 0;
};

struct ConnectionCut {
  std::size_t connection = 0;  // index
  bool sent_too_much = false;  // else: too many of them
};

// `connections`: in the order in which they came. The rest keeps within all three bounds.
std::vector<ConnectionCut> CutsAmong(std::span<const BoundedConnection> connections,
                                     const ConnectionBounds& bounds);

// What was read of a known client's connection, and what answers brought back.
struct ReadBytes {
  std::int64_t calls = 0;
  std::int64_t messages = 0;
  std::int64_t message_bytes = 0;
  std::int64_t answers = 0;  // messages
};

// Bytes of a connection that belong to nothing that was read, by the kernel's counts:
// they rise by what is received, and fall by what that brought. Never below 0, so that
// nobody can save up for later.
class UnreadBytes {
 public:
  std::int64_t Update(std::int64_t received, std::int64_t acknowledged, const ReadBytes& read,
                      std::int64_t now_ns);

 private:
  std::int64_t unread_ = 0;
  std::int64_t balance_ = 0;  // received, less all that may be, as of the last time
  std::int64_t first_ns_ = 0;
};

}  // namespace palpate
