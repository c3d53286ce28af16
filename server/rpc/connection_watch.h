// Watches the connections of strangers over TLS, and cuts off those beyond CutsAmong: gRPC's
// own quotas do not see all that they send. The kernel counts it.
//
// Known clients' connections are not watched, but kept, so that one ends whose client is known no
// more: a client that sends headers without an end makes no call that could be refused.
//
// Only the connection is cut off; its address may connect again at once. Others behind the same
// NAT share that address, and CutsAmong bounds what all strangers send together.
//
// Threads: any; it looks at them on one of its own, while there are some. Not the acceptor's:
// gRPC may read from a connection for as long as something comes on the thread that gave it.
#pragma once

#include <sys/socket.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/security/policy.h"
#include "server/security/refusal_log.h"

namespace palpate {

class ConnectionWatch {
 public:
  // At a gigabit a second, some megabyte comes in between.
  static constexpr std::chrono::milliseconds kReviewTime{10};

  // first_file: as FirstSecondFile.
  explicit ConnectionWatch(int first_file) : first_file_(first_file) {}
  ~ConnectionWatch();
  ConnectionWatch(const ConnectionWatch&) = delete;
  ConnectionWatch& operator=(const ConnectionWatch&) = delete;

  // Once, before the first connection.
  void Start();
  // A stranger's connection, which stays the caller's. False: there are no file numbers; to be
  // closed.
  bool Enter(int fd, const sockaddr_storage& peer);
  // Its client is known from now on, by these. `peer`: as gRPC names it.
  void Admitted(const std::string& peer, const Credentials& credentials);
  // Ends the connections of clients that are known no more, kGrace after that was seen first: until
  // then their calls are told why. `recognises` may take its time.
  static constexpr std::chrono::seconds kGrace{3};
  void EndUnless(const std::function<bool(const Credentials&)>& recognises, std::int64_t now_ns);

 private:
  struct Connection {
    std::string prefix{};
    std::uint64_t number = 0;  // in the order in which they came
    int fd = -1;               // a second one of its connection
    std::int64_t received_bytes = 0;
  };
  struct Known {
    int fd = -1;  // as above
    Credentials credentials{};
    std::uint64_t number = 0;     // as above
    std::int64_t refused_ns = 0;  // since when it is known no more; 0: it is known
  };
  using Connections = std::map<std::string, Connection>;  // by their peers

  void Run();
  std::vector<std::string> Review();
  void ForgetEndedKnown();
  Connections::iterator Forget(Connections::iterator connection);
  void CutOff(const Connections::value_type& connection, bool sent_too_much,
              std::vector<std::string>& lines);

  const int first_file_;
  std::mutex mutex_;
  Connections connections_;             // of strangers
  std::map<std::string, Known> known_;  // by their peers
  std::uint64_t entered_ = 0;
  RefusalLog log_budget_;
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

// As gRPC 1.51 names it: "ipv4:10.0.0.7:51312", "ipv6:%5B::1%5D:51312".
std::string PeerName(const sockaddr_storage& address);

}  // namespace palpate
