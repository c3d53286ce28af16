// Watches the connections over TLS, and cuts off those beyond CutsAmong: gRPC's own quotas
// do not see all that they send. The kernel counts it.
//
// Whose connection sent too much may not connect for ten seconds, with all of its address.
// Threads: any; it looks at them on one of its own, while there are some. Not the acceptor's:
// gRPC may read from a connection for as long as something comes on the thread that gave it.
#pragma once

#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/realtime/tick_timer.h"
#include "server/security/connection_limits.h"
#include "server/security/refusal_log.h"

namespace palpate {

// ReadBytes of a connection, counted by its calls on any thread.
struct ReadCounts {
  std::atomic<std::int64_t> calls{0};
  std::atomic<std::int64_t> messages{0};
  std::atomic<std::int64_t> message_bytes{0};
  std::atomic<std::int64_t> answers{0};
};

class ConnectionWatch {
 public:
  // At a gigabit a second, some megabyte comes in between; ten from a known client.
  static constexpr std::chrono::milliseconds kStrangersReviewTime{10};
  static constexpr std::chrono::milliseconds kKnownReviewTime{100};

  // first_file: as FirstSecondFile. now_ns: the clock; tests bring their own.
  explicit ConnectionWatch(int first_file, std::function<std::int64_t()> now_ns = MonotonicNowNs)
      : first_file_(first_file), now_ns_(std::move(now_ns)) {}
  ~ConnectionWatch();
  ConnectionWatch(const ConnectionWatch&) = delete;
  ConnectionWatch& operator=(const ConnectionWatch&) = delete;

  // Once, before the first connection.
  void Start();
  // A stranger's connection, which stays the caller's. False: its address is kept out, or
  // there are no file numbers; to be closed.
  bool Enter(int fd, const sockaddr_storage& peer);
  // Is of a known client from now on. `peer`: as gRPC names it.
  void Admitted(const std::string& peer, const std::string& identity);
  // Where its calls count what they read; null where nobody watches it.
  std::shared_ptr<ReadCounts> CountsOf(const std::string& peer) const;

 private:
  struct Connection {
    std::string peer{};
    std::uint64_t number = 0;  // in the order in which they came
    int fd = -1;               // a second one of its connection
    std::string identity{};    // empty: a stranger's
    std::shared_ptr<ReadCounts> counts{};
    UnreadBytes unread{};
    std::int64_t received_bytes = 0;
    std::int64_t acknowledged_bytes = 0;
  };

  void Run();
  std::vector<std::string> Review();
  void CutOffBeyond(const ConnectionBounds& bounds, bool is_known, std::int64_t now_ns,
                    std::vector<std::string>& lines);
  void CutOff(const Connection& connection, bool sent_too_much, std::int64_t now_ns,
              std::vector<std::string>& lines);

  const int first_file_;
  const std::function<std::int64_t()> now_ns_;
  mutable std::mutex mutex_;
  std::map<std::string, Connection> connections_;  // by their peers
  std::uint64_t entered_ = 0;
  std::size_t strangers_ = 0;
  std::int64_t known_review_ns_ = 0;              // the last of all
  std::map<std::string, std::int64_t> kept_out_;  // addresses, and until when
  RefusalLog log_budget_;
  bool stop_ = false;
  std::condition_variable changed_;
  std::thread thread_;
};

// As gRPC 1.51 names it: "ipv4:10.0.0.7:51312", "ipv6:%5B::1%5D:51312".
std::string PeerName(const sockaddr_storage& address);

}  // namespace palpate
