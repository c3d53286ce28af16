// Watches the connections over TLS on which nobody has made a call that he may make yet,
// and cuts off those beyond CutsAmongStrangers: gRPC's own quotas do not see all that
// they send. The kernel counts it.
//
// Whose connection sent too much may not connect for ten seconds, with all of its address.
// Threads: any; it looks at them on one of its own, while there are some. Not the acceptor's:
// gRPC may read from a connection for as long as something comes on the thread that gave it.
#pragma once

#include <sys/socket.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/security/refusal_log.h"

namespace palpate {

class StrangerWatch {
 public:
  // At a gigabit a second, some megabyte comes in between.
  static constexpr std::chrono::milliseconds kReviewTime{10};
  static constexpr std::int64_t kOutsideNs = 10'000'000'000;

  StrangerWatch() = default;
  ~StrangerWatch();
  StrangerWatch(const StrangerWatch&) = delete;
  StrangerWatch& operator=(const StrangerWatch&) = delete;

  // A connection, which stays the caller's. False: its address is kept out, or there are
  // no file numbers; to be closed.
  bool Enter(int fd, const sockaddr_storage& peer);
  // Is none any more. `peer`: as gRPC names it.
  void Admitted(const std::string& peer);

 private:
  struct Stranger {
    std::string peer;
    int fd = -1;  // a second one of its connection
  };

  void Run();
  std::vector<std::string> Review();
  void CutOff(const Stranger& stranger, bool sent_too_much, std::vector<std::string>& lines);

  std::mutex mutex_;
  std::vector<Stranger> strangers_;               // in the order in which they came
  std::map<std::string, std::int64_t> kept_out_;  // addresses, and until when
  RefusalLog log_budget_;
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

// As gRPC 1.51 names it: "ipv4:10.0.0.7:51312", "ipv6:%5B::1%5D:51312".
std::string PeerName(const sockaddr_storage& address);

}  // namespace palpate
