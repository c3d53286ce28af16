// The address of a palpated, credentials for it, and the state of the connection.
//
// Threads: plain values.
#pragma once

#include <string>

namespace palpate::client {

// Set at most one of the first two. If both are empty: $PALPATE_SERVER, or else the default socket
// of DefaultSocketPath in common/wire/address.h ($PALPATE_SOCKET, /run/palpate, the user's own
// folder).
struct Address {
  std::string socket_path{};  // a Unix socket on this machine
  std::string host_port{};    // "localhost:7400", "[::1]:7400"
  // "viewer", "editor", "operator" or "admin": the socket of this role beside socket_path. Empty:
  // the highest of them that this process may open.
  std::string role{};
};

// How the client and the daemon prove who they are. For TCP with TLS. TLS is used if an authority
// or a certificate is given. All files are PEM; they are read at every attempt to connect. The
// environment may fill empty fields: server_choice.h.
struct Credentials {
  std::string ca_file{};           // of the daemon's authority; empty: the system's authorities
  std::string certificate_file{};  // ours, with its key, if the daemon knows it
  std::string key_file{};
  // File with a token, as 'palpated token add' printed it. Never sent without TLS.
  std::string token_file{};
};

enum class ConnectionState {
  kConnecting,  // the first attempt is under way
  kConnected,   // palpated answers
  kLost,        // palpated does not answer; the client tries again and again
};

struct Connection {
  ConnectionState state = ConnectionState::kConnecting;
  // If the connection is lost: the reason in one line for people, and what to do if that is known.
  std::string why;
};

}  // namespace palpate::client
