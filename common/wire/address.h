// Where palpated is reached: a Unix socket, or host and port.
//
// The daemon listens on, and every client connects to, what these functions
// return. Any thread. Errors: Error with kInvalidArgument unless stated.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace palpate {

// Longest path of a Unix socket in bytes (sockaddr_un holds 108 with its NUL).
inline constexpr std::size_t kMaxSocketPathLength = 107;

// $PALPATE_SOCKET when it is set and not empty; else palpated.sock in
// `system_folder`, where that is a folder we may write or that holds the socket;
// else in $XDG_RUNTIME_DIR/palpate; else in /tmp/palpate-<uid>. The folder may
// not exist yet.
// Errors: also kPermissionDenied when the folder in /tmp belongs to somebody
// else or is open to others, who could then put their own socket there.
std::string DefaultSocketPath(const std::string& system_folder = "/run/palpate");

// "unix:/absolute/path" for gRPC, on the server and on the client. A relative
// path is taken from the current folder. Refused: an empty path, one that is too
// long, and characters that gRPC would read as parts of a URI.
std::string UnixTarget(const std::string& path);

// An address in TCP.
struct HostPort {
  std::string host;  // name, IPv4 address, or IPv6 address without brackets
  std::uint16_t port = 0;

  // "host:port", IPv6 in brackets: what grpc::ServerBuilder listens on, and what
  // people read.
  std::string ToString() const;
};

// Parses "127.0.0.1:7400", "localhost:7400" or "[::1]:7400"; port 1 to 65535.
HostPort ParseHostPort(std::string_view text);

// Whether it is an address of this machine alone. Only literal ones: a name may resolve
// to anything.
bool IsLoopback(const HostPort& address);

// Target of a gRPC channel to that address.
std::string TcpTarget(const HostPort& address);

}  // namespace palpate
