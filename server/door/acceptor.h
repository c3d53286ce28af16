// Accepts connections of one address for gRPC and refuses connections above a limit.
//
// gRPC 1.51 cannot do this itself. It does not limit connections. It also stops listening for good
// once accept() finds no free file number (gRPC issues 16058 and 20418); no client could reach
// palpated then.
//
// Threads: Start and Stop on the main thread; a thread of its own accepts.
// Errors: Error (kConflict, kPermissionDenied); the message says what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <sys/types.h>

#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "common/wire/address.h"
#include "server/door/connection_watch.h"
#include "server/door/deaf_watch.h"

namespace palpate {

// Throws kInvalidArgument for a host name: a name may stand for several addresses, or for none.
void CheckAddress(const HostPort& address);

class Acceptor {
 public:
  using Sink = std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor>;

  // Closes a connection at once if its file number is `first_refused_file` or above.
  Acceptor(int first_refused_file, ConnectionWatch& watch)
      : first_refused_file_(first_refused_file), watch_(watch) {}
  ~Acceptor() { Stop(); }
  Acceptor(const Acceptor&) = delete;
  Acceptor& operator=(const Acceptor&) = delete;

  // One of these binds the address, so that no other process can take it. Clients cannot connect
  // before Start. `group`: owns the socket's file; none: as every file that the process makes.
  // deaf_watch: gets the connections; may be null.
  void TakeSocket(const std::string& path, mode_t mode, std::optional<gid_t> group,
                  DeafWatch* deaf_watch);
  // Without a role, the port has TLS, and a client is a stranger until its first admitted call.
  void TakePort(const HostPort& address, std::optional<Role> loopback_role);
  // Listens. `sink`: receives the connections. gRPC's server must be
  // running.
  void Start(Sink sink);
  // Stops accepting. Call it before gRPC's server ends.
  void Stop();

 private:
  void Run();
  void Accept();

  const int first_refused_file_;
  ConnectionWatch& watch_;
  DeafWatch* deaf_watch_ = nullptr;
  std::optional<Role> loopback_role_{};
  int listener_ = -1;
  std::string name_;  // the listener's name, for messages
  Sink sink_;
  int wake_fd_ = -1;
  std::thread thread_;
};

}  // namespace palpate
