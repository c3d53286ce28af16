// Where palpated is, and whether it is reached.
//
// Threads: plain values.
#pragma once

#include <string>

namespace palpate::client {

// At most one of the two; both empty: $PALPATE_SERVER, or else the default socket, that of
// DefaultSocketPath in common/wire/address.h ($PALPATE_SOCKET, /run/palpate, the user's own
// folder).
struct Address {
  std::string socket_path{};  // a Unix socket on this machine
  std::string host_port{};    // "localhost:7400", "[::1]:7400"
};

// How a client proves who it is, and the daemon that it is the daemon: for TCP with TLS,
// which is used where an authority or a certificate is given. Files in PEM, read at
// every attempt to connect. What is empty the environment may fill: server_choice.h.
struct Credentials {
  std::string ca_file{};           // of the daemon's authority; empty: those of the system
  std::string certificate_file{};  // ours, with its key, where the daemon knows it
  std::string key_file{};
  // Holds a token, as 'palpated token add' printed it. Never sent without TLS.
  std::string token_file{};
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
