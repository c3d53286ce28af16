#include "server/door/connection_watch.h"

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
constexpr double kLongestReviewS = 0.2;

// False if the connection has ended.
bool AskKernel(int fd, std::int64_t& received_bytes) {
  tcp_info info{};
  socklen_t size = sizeof(info);
  if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return false;
  received_bytes = static_cast<std::int64_t>(info.tcpi_bytes_received);
  return info.tcpi_state == kEstablished;
}

// gRPC would still read what has come before a shutdown. This drops it.
void Disconnect(int fd) {
  const sockaddr none{.sa_family = AF_UNSPEC, .sa_data = {}};
  connect(fd, &none, sizeof none);
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
                            std::optional<Role> loopback_role) {
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
  connection = {.prefix = PrefixOf(peer), .number = entered_++, .fd = second_fd};
  if (loopback_role) {
    connection.known = Credentials{.entry = {Transport::kPlain}};
    connection.role = *loopback_role;
  }
  is_busy_ = is_busy_ || !loopback_role;
  changed_.notify_all();
  return true;
}

void ConnectionWatch::Admitted(const std::string& peer, const Credentials& credentials, Role role,
                               bool is_credited) {
  const std::lock_guard lock(mutex_);
  if (const auto found = connections_.find(peer); found != connections_.end()) {
    found->second.known = credentials;
    found->second.role = role;
    if (is_credited) found->second.credit_bytes += kBytesPerCall;
  }
}

void ConnectionWatch::Credit(const std::string& peer, std::int64_t bytes) {
  const std::lock_guard lock(mutex_);
  const auto found = connections_.find(peer);
  if (found != connections_.end()) found->second.credit_bytes += bytes;
}

void ConnectionWatch::TakesSamples(const std::string& peer, int samples_per_s) {
  const std::lock_guard lock(mutex_);
  const auto found = connections_.find(peer);
  if (found != connections_.end()) found->second.samples_per_s += samples_per_s;
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
    found->second.idle_bytes = found->second.received_bytes;  // gRPC may still hold all of them
    is_busy_ = true;
  }
  changed_.notify_all();
}

void ConnectionWatch::Cut(const std::string& peer) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = connections_.find(peer);
    if (found == connections_.end()) return;
    Disconnect(found->second.fd);
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

// Only disconnects. The next review notices their end and removes them.
std::vector<ConnectionWatch::Excess> ConnectionWatch::Review() {
  DropEnded();
  const std::int64_t now_ns = MonotonicNowNs();
  // Without connections, there were no reviews: what has come since then came just now.
  const double elapsed_s = std::min(
      kLongestReviewS, 1e-9 * static_cast<double>(now_ns - std::exchange(reviewed_ns_, now_ns)));
  is_busy_ = false;
  std::vector<Excess> cuts;
  CutStrangers(cuts);
  CutIdle(elapsed_s, cuts);
  return cuts;
}

void ConnectionWatch::CutStrangers(std::vector<Excess>& cuts) {
  std::vector<const Connections::value_type*> strangers;
  for (const auto& one : connections_) {
    if (!one.second.known) strangers.push_back(&one);
  }
  is_busy_ = !strangers.empty();
  std::ranges::sort(strangers, {}, [](const auto* one) { return one->second.number; });
  std::vector<std::string> prefixes;
  for (const auto* const one : strangers) prefixes.push_back(one->second.prefix);
  for (const std::size_t cut : CutsAmong(prefixes)) {
    Disconnect(strangers[cut]->second.fd);
    cuts.push_back({strangers[cut]->first, false});
  }
}

void ConnectionWatch::CutIdle(double elapsed_s, std::vector<Excess>& cuts) {
  const auto in_time = [elapsed_s](std::int64_t bytes_per_s) {
    return static_cast<std::int64_t>(elapsed_s * static_cast<double>(bytes_per_s));
  };
  const auto add = [&](std::int64_t bytes, std::int64_t forgotten_per_s, std::int64_t& sum) {
    sum = std::max<std::int64_t>(0, sum + bytes - in_time(forgotten_per_s));
  };
  std::int64_t of_all = 0;
  for (auto& [peer, one] : connections_) {
    const std::int64_t sent =
        one.received_bytes - std::exchange(one.counted_bytes, one.received_bytes);
    const std::int64_t used =
        std::exchange(one.credit_bytes, 0) + in_time(kBytesPerSample * one.samples_per_s);
    if (MayEdit(one)) continue;
    const std::int64_t idle = std::max<std::int64_t>(0, sent - used);
    add(idle, kIdleBytesOfOnePerS, one.idle_bytes);
    of_all += idle;
  }
  add(of_all, kIdleBytesOfAllPerS, idle_bytes_);
  // Afterwards newcomers are free again within seconds.
  idle_bytes_ = std::min(idle_bytes_, 2 * kIdleBytesOfAll);
  is_busy_ = is_busy_ || idle_bytes_ > 0;
  const std::int64_t most = idle_bytes_ > kIdleBytesOfAll ? kLittleIdleBytes : kIdleBytesOfOne;
  for (auto& [peer, one] : connections_) {
    if (MayEdit(one) || one.idle_bytes <= most) continue;
    Disconnect(one.fd);
    cuts.push_back({peer, true});
  }
}

}  // namespace palpate
