// Where palpated is, and whether it is reached.
//
// Threads: plain values.
#pragma once

#include <string>

namespace palpate::client {

// At most one of the two; both empty: the default socket, that of DefaultSocketPath
// in common/wire/address.h ($PALPATE_SOCKET, /run/palpate, the user's own folder).
struct Address {
  std::string socket_path{};  // a Unix socket on this machine
  std::string host_port{};    // "localhost:7400", "[::1]:7400"
};

enum class ConnectionState {
  kConnecting,  // the first attempt is under way
  kConnected,   // palpated answers
  kLost,        // it does not, or does not yet; it is tried again and again
};

struct Connection {
  ConnectionState state = ConnectionState::kConnecting;
  // Where it is lost: one line for people, with what to do where that is known.
  std::string why;
};

}  // namespace palpate::client
