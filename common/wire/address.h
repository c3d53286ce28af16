// The address of palpated: a Unix socket, or host and port.
//
// The daemon listens on the results of these functions, and every client connects to them. Any
// thread. Errors: Error with kInvalidArgument unless stated.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/contract/enumerations.h"

namespace palpate {

// Longest path of a Unix socket in bytes (sockaddr_un holds 108 with its NUL).
inline constexpr std::size_t kMaxSocketPathLength = 107;

// Returns the first of these:
// - $PALPATE_SOCKET, if it is set and not empty
// - palpated.sock in `system_folder`, if that is a folder that we may write, or that holds a
//   socket that we may open: this one, or that of a lower role
// - palpated.sock in $XDG_RUNTIME_DIR/palpate, or else in /tmp/palpate-<uid>; the folder may not
//   exist yet
// Errors: also kPermissionDenied if the folder in /tmp belongs to another user or is open to
// others, who could then put their own socket there.
std::string DefaultSocketPath(const std::string& system_folder = "/run/palpate");

// Returns "unix:/absolute/path" for gRPC servers and clients. A relative path is taken from the
// current folder. Refuses an empty path, a path that is too long, and characters that gRPC would
// read as parts of a URI.
std::string UnixTarget(const std::string& path);

// The socket whose clients have this role: "/run/palpate/palpated-viewer.sock" for
// "/run/palpate/palpated.sock". Of admins it is the usual socket itself.
std::string RoleSocketPath(const std::string& usual_path, Role role);

// The usual socket beside which the socket of a role lies. Any other path stays.
std::string UsualSocketPath(const std::string& path);

// The socket of a door (server/door/entrance.h) for callers of this role:
// "/run/palpate/palpated-door-viewer.sock".
std::string DoorSocketPath(const std::string& usual_path, Role role);

// The stop's socket of a door: "/run/palpate/palpated-door-stop.sock".
std::string DoorStopPath(const std::string& usual_path);

// The highest of the usual socket and those of lower roles that this process may open; the usual
// one if there is none.
std::string HighestSocketPath(const std::string& usual_path);

// The socket for the emergency stop alone, beside palpated's other one:
// "/run/palpate/palpated-stop.sock" for "/run/palpate/palpated.sock". A role's socket has one if it
// has a group of its own.
std::string StopSocketPath(const std::string& socket_path);

// The stop's socket for a client of this socket: beside it, or else that of the usual socket.
std::string FindStopSocket(const std::string& socket_path);

// A TCP address.
struct HostPort {
  std::string host;  // name, IPv4 address, or IPv6 address without brackets
  std::uint16_t port = 0;

  // "host:port", IPv6 in brackets: for grpc::ServerBuilder and for people.
  std::string ToString() const;
};

// Parses "127.0.0.1:7400", "localhost:7400" or "[::1]:7400"; port 1 to 65535.
HostPort ParseHostPort(std::string_view text);

// True if the address belongs to this machine alone. Only for literal addresses: a name may resolve
// to anything.
bool IsLoopback(const HostPort& address);

// The target of a gRPC channel to that address.
std::string TcpTarget(const HostPort& address);

}  // namespace palpate
