// Accepts connections for gRPC and refuses connections above a limit.
//
// gRPC 1.51 cannot do this itself. It does not limit connections. It also stops listening for good
// once accept() finds no free file number (gRPC issues 16058 and 20418); no client could reach
// palpated then.
//
// Threads: Start and Stop on the main thread; a thread of its own accepts.
// Errors: Error (kConflict, kPermissionDenied); the message says what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/wire/address.h"
#include "server/door/connection_watch.h"

namespace palpate {

// Throws kInvalidArgument for a host name: a name may stand for several addresses, or for none.
void CheckAddress(const HostPort& address);

class Acceptor {
 public:
  static constexpr int kKeptForSocket = 64;
  using Sink = std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor>;

  // Closes a connection at once if its file number is `first_refused_file` or above. The socket
  // has kKeptForSocket more file numbers, so that a flood on the port does not keep the
  // workstation's own users from the emergency stop.
  Acceptor(int first_refused_file, ConnectionWatch& watch)
      : first_refused_file_(first_refused_file), watch_(watch) {}
  ~Acceptor() { Stop(); }
  Acceptor(const Acceptor&) = delete;
  Acceptor& operator=(const Acceptor&) = delete;

  // TakeSocket and TakePort bind the address, so that no other process can take it. Clients cannot
  // connect before Start. The socket's file gets the mode 0660.
  void TakeSocket(const std::string& path);
  // Without a role, the port has TLS, and a client is a stranger until its first admitted call.
  void TakePort(const HostPort& address, std::optional<Role> loopback_role);
  // Listens. `sinks`: the receivers of the connections, in the order in which the addresses were
  // taken. gRPC's server must be running.
  void Start(std::vector<Sink> sinks);
  // Stops accepting. Call it before gRPC's server ends.
  void Stop();

 private:
  void Run();
  void Accept(std::size_t listener);

  const int first_refused_file_;
  ConnectionWatch& watch_;
  std::optional<Role> loopback_role_{};
  std::vector<int> listeners_;
  std::vector<std::string> names_;  // the listeners' names, for messages
  std::vector<Sink> sinks_;
  int wake_fd_ = -1;
  std::thread thread_;
};

}  // namespace palpate
