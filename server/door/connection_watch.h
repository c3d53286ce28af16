// Watches the TCP connections of strangers and viewers. Cuts off the connections that CutsAmong
// chooses, and those that send too much for nothing (kIdleBytesOfOne). gRPC's own quotas miss some
// of the received bytes; the watch uses the kernel's count.
//
// A TLS connection is a stranger's until a call on it is allowed, and again when its client is no
// longer allowed: a client that sends endless headers makes no call that could be refused.
//
// Clients who may only watch have little to send. gRPC 1.51 reads from a connection as long as
// bytes come, on one of its few threads, and puts what follows into one queue. Without a bound, a
// few connections would keep these threads from all other clients, and from the emergency stop.
//
// The watch does not ban addresses: a cut-off peer may connect again at once. Other clients behind
// the same NAT share the address, and CutsAmong bounds what all strangers send together.
//
// Threads: any. A thread of its own checks connections while there are any. The acceptor's thread
// cannot do it: gRPC may read from a connection on the thread that handed the connection over, for
// as long as data comes.
#pragma once

#include <sys/socket.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/security/connection_limits.h"
#include "server/security/policy.h"

namespace palpate {

class ConnectionWatch {
 public:
  // The time between two checks, while there are strangers or somebody sends much. At 1 Gbit/s
  // about 1 MB arrives in this time.
  static constexpr std::chrono::milliseconds kReviewTime{10};
  static constexpr std::chrono::milliseconds kCalmTime{100};

  // first_file: lowest number for the watch's duplicated descriptors; see FirstSecondFile.
  explicit ConnectionWatch(int first_file) : first_file_(first_file) {}
  ~ConnectionWatch();
  ConnectionWatch(const ConnectionWatch&) = delete;
  ConnectionWatch& operator=(const ConnectionWatch&) = delete;

  // Call it once, before the first connection.
  void Start();
  // Adds a connection: a stranger's, or of a client that loopback gives this role. The caller keeps
  // ownership of `fd`; the watch duplicates it. Returns false if no file number is free: the caller
  // must then close the connection.
  bool Enter(int fd, const sockaddr_storage& peer, std::optional<Role> loopback_role = {});
  // A call on this connection was allowed by `credentials`. The newest count. `peer`: the name in
  // gRPC's form. `is_credited`: the bytes of the call are not sent for nothing.
  void Admitted(const std::string& peer, const Credentials& credentials, Role role,
                bool is_credited = true);
  // So many bytes of the client's next ones are not sent for nothing.
  void Credit(const std::string& peer, std::int64_t bytes);
  // The client takes so many samples of poses more, or less.
  void TakesSamples(const std::string& peer, int samples_per_s);
  // Connections whose client has no role any more are strangers' from now on. Call it now and then:
  // it also forgets connections that have ended. `role_of` is called without the lock and may be
  // slow.
  void Judge(const std::function<std::optional<Role>(const Credentials&)>& role_of);
  // Cuts off a connection whose client calls and does not read. Nothing if it is not watched.
  void Cut(const std::string& peer);

 private:
  struct Connection {
    std::string prefix{};
    std::uint64_t number = 0;  // rises in the order in which connections came
    int fd = -1;               // a duplicate; owned
    std::int64_t received_bytes = 0;
    std::optional<Credentials> known{};  // none: a stranger's
    Role role = Role::kViewer;
    std::int64_t counted_bytes = 0;  // of received_bytes, up to the last check
    std::int64_t credit_bytes = 0;   // of calls since then
    int samples_per_s = 0;
    std::int64_t idle_bytes = 0;  // see kIdleBytesOfOne
  };
  using Connections = std::map<std::string, Connection>;  // by their peers

  struct Excess {
    std::string peer;
    bool sent_too_much;
  };

  void Run();
  void DropEnded();
  std::vector<Excess> Review();
  void CutStrangers(std::vector<Excess>& cuts);
  static bool MayEdit(const Connection& one) { return one.known && one.role >= Role::kEditor; }
  void CutIdle(double elapsed_s, std::vector<Excess>& cuts);

  const int first_file_;
  std::mutex mutex_;
  Connections connections_;
  std::uint64_t entered_ = 0;
  std::int64_t reviewed_ns_ = 0;
  std::int64_t idle_bytes_ = 0;  // of all; see kIdleBytesOfAll
  bool is_busy_ = false;         // strangers are there, or viewers who send much
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

// The peer's name in the form of gRPC 1.51: "ipv4:10.0.0.7:51312", "ipv6:%5B::1%5D:51312".
std::string PeerName(const sockaddr_storage& address);

}  // namespace palpate
