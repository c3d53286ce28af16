// Accepts connections for gRPC, and refuses those that are too many.
//
// gRPC 1.51 itself stops listening for good once accept() finds no free file number,
// (its issues 16058 and 20418), and then palpated could be reached no more; nor does it
// bound connections.
//
// Threads: Start and Stop on the main one; accepting on one of its own.
// Errors: Error (kConflict, kPermissionDenied) with what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/wire/address.h"
#include "server/rpc/connection_watch.h"

namespace palpate {

// Throws kInvalidArgument for a name: it may be that of several addresses, or of none.
void CheckAddress(const HostPort& address);

class Acceptor {
 public:
  static constexpr int kKeptForSocket = 64;
  using Sink = std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor>;

  // Connections whose file number is `first_refused_file` or above are closed at once;
  // kKeptForSocket more are accepted on sockets, so that a flood on the port does not
  // keep the workstation's own users from the emergency stop.
  Acceptor(int first_refused_file, ConnectionWatch& watch)
      : first_refused_file_(first_refused_file), watch_(watch) {}
  ~Acceptor() { Stop(); }
  Acceptor(const Acceptor&) = delete;
  Acceptor& operator=(const Acceptor&) = delete;

  // Take the address, so that nobody else does; nobody can connect yet. The socket's
  // file gets the mode 0660.
  void TakeSocket(const std::string& path);
  // is_watched: those over TLS.
  void TakePort(const HostPort& address, bool is_watched);
  // Listens. Where the connections go, in the order of the addresses; gRPC's server runs.
  void Start(std::vector<Sink> sinks);
  // Before gRPC's server ends.
  void Stop();

 private:
  void Run();
  void Accept(std::size_t listener);
  void Refuse(const std::string& peer);

  const int first_refused_file_;
  ConnectionWatch& watch_;
  int watched_listener_ = -1;
  std::vector<int> listeners_;
  std::vector<std::string> names_;  // theirs, for people
  std::vector<Sink> sinks_;
  int wake_fd_ = -1;
  std::uint64_t refused_ = 0;
  std::int64_t last_line_ns_ = 0;
  std::thread thread_;
};

}  // namespace palpate
