#include "server/rpc/connection_watch.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <utility>

#include "server/log/log.h"
#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

// From <netinet/tcp.h>, which cannot be included together with <linux/tcp.h>.
constexpr int kEstablished = 1;
constexpr int kPriority = 1;

// False if the connection has ended.
bool AskKernel(int fd, std::int64_t& received_bytes) {
  tcp_info info{};
  socklen_t size = sizeof(info);
  if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return false;
  received_bytes = static_cast<std::int64_t>(info.tcpi_bytes_received);
  return info.tcpi_state == kEstablished;
}

std::string NameOf(const in_addr& address, std::uint16_t port) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address, text, sizeof(text));
  return std::string("ipv4:") + text + ":" + std::to_string(ntohs(port));
}

const char* ReasonFor(bool sent_too_much) {
  return sent_too_much
             ? "it sent too much for a client that may only watch, or made no call that it may make"
             : "too many are connected without a call that they may make";
}

}  // namespace

std::string PeerName(const sockaddr_storage& address) {
  if (address.ss_family == AF_INET) {
    const auto& v4 = reinterpret_cast<const sockaddr_in&>(address);
    return NameOf(v4.sin_addr, v4.sin_port);
  }
  const auto& v6 = reinterpret_cast<const sockaddr_in6&>(address);
  if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
    in_addr v4{};
    std::copy_n(v6.sin6_addr.s6_addr + 12, 4, reinterpret_cast<unsigned char*>(&v4));
    return NameOf(v4, v6.sin6_port);
  }
  char text[INET6_ADDRSTRLEN] = "";
  inet_ntop(AF_INET6, &v6.sin6_addr, text, sizeof(text));
  const std::string scope = v6.sin6_scope_id == 0 ? "" : "%25" + std::to_string(v6.sin6_scope_id);
  return std::string("ipv6:%5B") + text + scope + "%5D:" + std::to_string(ntohs(v6.sin6_port));
}

ConnectionWatch::~ConnectionWatch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  for (const auto& [peer, connection] : connections_) close(connection.fd);
}

void ConnectionWatch::Start() {
  thread_ = std::thread([this] { Run(); });
}

bool ConnectionWatch::Enter(int fd, const sockaddr_storage& peer,
                            const std::optional<Credentials>& known) {
  const std::lock_guard lock(mutex_);
  int second_fd = fcntl(fd, F_DUPFD_CLOEXEC, first_file_);
  if (second_fd < 0) {
    DropEnded();
    second_fd = fcntl(fd, F_DUPFD_CLOEXEC, first_file_);
  }
  if (second_fd < 0) return false;
  Connection& connection = connections_[PeerName(peer)];
  // An ended connection of the same port may still be in the list.
  if (connection.fd >= 0) close(connection.fd);
  connection = {.prefix = PrefixOf(peer), .number = entered_++, .fd = second_fd, .known = known};
  is_busy_ = is_busy_ || !known;
  changed_.notify_all();
  return true;
}

void ConnectionWatch::Admitted(const std::string& peer, const Credentials& credentials, Role role) {
  const std::lock_guard lock(mutex_);
  if (const auto found = connections_.find(peer); found != connections_.end()) {
    found->second.known = credentials;
    found->second.role = role;
  }
}

void ConnectionWatch::Judge(const std::function<std::optional<Role>(const Credentials&)>& role_of) {
  std::unique_lock lock(mutex_);
  DropEnded();
  const Connections asked = connections_;
  lock.unlock();  // the acceptor needs it
  std::vector<std::pair<const Connections::value_type*, std::optional<Role>>> judged;
  for (const auto& one : asked) {
    if (one.second.known) judged.emplace_back(&one, role_of(*one.second.known));
  }
  lock.lock();
  for (const auto& [one, role] : judged) {
    const auto found = connections_.find(one->first);
    // A new connection of the same port may have replaced it, or a call with other credentials.
    if (found == connections_.end() || found->second.number != one->second.number ||
        found->second.known != one->second.known) {
      continue;
    }
    found->second.role = role.value_or(Role::kViewer);
    if (role) continue;
    found->second.known.reset();
    is_busy_ = true;
  }
  changed_.notify_all();
}

void ConnectionWatch::Cut(const std::string& peer) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = connections_.find(peer);
    if (found == connections_.end()) return;
    shutdown(found->second.fd, SHUT_RDWR);
  }
  LogOfClient(LogLevel::kWarning, "cut off", "cut off {}: it goes on calling and reads no answer",
              peer);
}

void ConnectionWatch::DropEnded() {
  for (auto at = connections_.begin(); at != connections_.end();) {
    Connection& connection = at->second;
    if (AskKernel(connection.fd, connection.received_bytes)) {
      ++at;
    } else {
      close(connection.fd);
      at = connections_.erase(at);
    }
  }
}

void ConnectionWatch::Run() {
  // The priority is far below the servo's, and above that of all threads that clients keep busy. So
  // clients cannot delay the next review, and cannot send more before it.
  RealtimeGrant grant;
  SetupRealtimeThread({.priority = kPriority, .lock_memory = false}, grant);
  pthread_setname_np(pthread_self(), "palpate-watch");
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stop_ || !connections_.empty(); });
    changed_.wait_for(lock, kCalmTime, [this] { return stop_ || is_busy_; });
    if (changed_.wait_for(lock, kReviewTime, [this] { return stop_; })) return;
    const std::vector<Excess> cuts = Review();
    lock.unlock();
    for (const Excess& cut : cuts) {
      LogOfClient(LogLevel::kWarning, "cut off", "cut off {}: {}", cut.peer,
                  ReasonFor(cut.sent_too_much));
    }
    lock.lock();
  }
}

// Only shuts connections down. The next review notices their end and removes them.
std::vector<ConnectionWatch::Excess> ConnectionWatch::Review() {
  DropEnded();
  const std::int64_t now_ns = MonotonicNowNs();
  const auto forgotten = static_cast<std::int64_t>(
      1e-9 * static_cast<double>(now_ns - std::exchange(reviewed_ns_, now_ns)) * kViewerBytesPerS);
  Bounded strangers, viewers;
  is_busy_ = false;
  for (auto& one : connections_) {
    Connection& connection = one.second;
    const std::int64_t sent = connection.received_bytes -
                              std::exchange(connection.counted_bytes, connection.received_bytes);
    connection.recent_bytes = std::max<std::int64_t>(0, connection.recent_bytes + sent - forgotten);
    if (!connection.known) {
      strangers.emplace_back(&one, connection.received_bytes);
      is_busy_ = true;
    } else if (connection.role < Role::kEditor) {
      viewers.emplace_back(&one, connection.recent_bytes);
      is_busy_ = is_busy_ || connection.recent_bytes > kViewerBounds.bytes_of_one / 8;
    }
  }
  std::vector<Excess> cuts;
  CutAmong(strangers, kStrangerBounds, cuts);
  CutAmong(viewers, kViewerBounds, cuts);
  return cuts;
}

void ConnectionWatch::CutAmong(Bounded& bounded, const ConnectionBounds& bounds,
                               std::vector<Excess>& cuts) {
  std::sort(bounded.begin(), bounded.end(), [](const auto& a, const auto& b) {
    return a.first->second.number < b.first->second.number;
  });
  std::vector<BoundedConnection> by_age;
  for (const auto& [one, bytes] : bounded) by_age.push_back({one->second.prefix, bytes});
  for (const ConnectionCut& cut : CutsAmong(by_age, bounds)) {
    const auto& [peer, connection] = *bounded[cut.connection].first;
    shutdown(connection.fd, SHUT_RDWR);
    cuts.push_back({peer, cut.sent_too_much});
  }
}

}  // namespace palpate
