#include "server/rpc/connection_watch.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>

#include "server/log/log.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

// Of <netinet/tcp.h>, which cannot stand beside <linux/tcp.h>.
constexpr int kEstablished = 1;
constexpr int kPriority = 1;
// How long an address is kept out.
constexpr std::int64_t kOutsideNs = 10'000'000'000;
constexpr std::int64_t kKnownReviewNs =
    std::chrono::nanoseconds(ConnectionWatch::kKnownReviewTime).count();

// False: it has ended.
bool AskKernel(int fd, std::int64_t& received_bytes, std::int64_t& acknowledged_bytes) {
  tcp_info info{};
  socklen_t size = sizeof(info);
  if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return false;
  received_bytes = static_cast<std::int64_t>(info.tcpi_bytes_received);
  acknowledged_bytes = static_cast<std::int64_t>(info.tcpi_bytes_acked);
  return info.tcpi_state == kEstablished;
}

ReadBytes ReadSoFar(const ReadCounts& counts) {
  return {.calls = counts.calls,
          .messages = counts.messages,
          .message_bytes = counts.message_bytes,
          .answers = counts.answers};
}

std::string NameOf(const in_addr& address, std::uint16_t port) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address, text, sizeof(text));
  return std::string("ipv4:") + text + ":" + std::to_string(ntohs(port));
}

const char* ReasonFor(bool is_known, bool sent_too_much) {
  if (!sent_too_much) return "too many are connected without a call that they may make";
  return is_known ? "it sent too much that is no call of it; its address is kept out for 10 s"
                  : "it sent too much without a call that it may make; its address is kept out "
                    "for 10 s";
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

bool ConnectionWatch::Enter(int fd, const sockaddr_storage& peer) {
  const std::lock_guard lock(mutex_);
  const std::string name = PeerName(peer);
  const auto outside = kept_out_.find(AddressOf(name));
  if (outside != kept_out_.end()) {
    if (now_ns_() < outside->second) return false;
    kept_out_.erase(outside);
  }
  const int second_fd = fcntl(fd, F_DUPFD_CLOEXEC, first_file_);
  if (second_fd < 0) return false;
  Connection& connection = connections_[name];
  // One of the same port that has ended, and was not looked at since.
  if (connection.fd >= 0) close(connection.fd);
  connection = {.peer = name,
                .number = entered_++,
                .fd = second_fd,
                .counts = std::make_shared<ReadCounts>()};
  ++strangers_;
  changed_.notify_all();
  return true;
}

void ConnectionWatch::Admitted(const std::string& peer, const std::string& identity) {
  const std::lock_guard lock(mutex_);
  const auto found = connections_.find(peer);
  if (found != connections_.end()) found->second.identity = identity;
}

std::shared_ptr<ReadCounts> ConnectionWatch::CountsOf(const std::string& peer) const {
  const std::lock_guard lock(mutex_);
  const auto found = connections_.find(peer);
  return found == connections_.end() ? nullptr : found->second.counts;
}

void ConnectionWatch::Run() {
  // Far below the servo, and before all that clients keep busy: what they send until the
  // next look must not depend on it.
  RealtimeGrant grant;
  SetupRealtimeThread({.priority = kPriority, .lock_memory = false}, grant);
  pthread_setname_np(pthread_self(), "palpate-watch");
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (connections_.empty()) {
      changed_.wait(lock);
    } else if (strangers_ > 0) {
      changed_.wait_for(lock, kStrangersReviewTime, [this] { return stop_; });
    } else {
      changed_.wait_for(lock, kKnownReviewTime, [this] { return stop_ || strangers_ > 0; });
    }
    const std::vector<std::string> lines = Review();
    lock.unlock();
    for (const std::string& line : lines) LogWarning("{}", line);
    lock.lock();
  }
}

std::vector<std::string> ConnectionWatch::Review() {
  const std::int64_t now_ns = now_ns_();
  const bool are_known_due = now_ns - known_review_ns_ >= kKnownReviewNs;
  if (are_known_due) known_review_ns_ = now_ns;
  strangers_ = 0;
  for (auto at = connections_.begin(); at != connections_.end();) {
    Connection& one = at->second;
    const bool is_stranger = one.identity.empty();
    if ((!is_stranger && !are_known_due) ||
        AskKernel(one.fd, one.received_bytes, one.acknowledged_bytes)) {
      strangers_ += is_stranger;
      ++at;
    } else {
      close(one.fd);
      at = connections_.erase(at);
    }
  }
  std::vector<std::string> lines;
  CutOffBeyond(kStrangerBounds, false, now_ns, lines);
  if (are_known_due) CutOffBeyond(kKnownBounds, true, now_ns, lines);
  std::erase_if(kept_out_, [&](const auto& address) { return address.second <= now_ns; });
  return lines;
}

void ConnectionWatch::CutOffBeyond(const ConnectionBounds& bounds, bool is_known,
                                   std::int64_t now_ns, std::vector<std::string>& lines) {
  std::vector<Connection*> connections;
  for (auto& [peer, connection] : connections_) {
    if (connection.identity.empty() != is_known) connections.push_back(&connection);
  }
  std::sort(connections.begin(), connections.end(),
            [](const Connection* a, const Connection* b) { return a->number < b->number; });
  std::vector<BoundedConnection> bounded;
  for (Connection* const one : connections) {
    const std::int64_t bytes =
        is_known ? one->unread.Update(one->received_bytes, one->acknowledged_bytes,
                                      ReadSoFar(*one->counts), now_ns)
                 : one->received_bytes;
    bounded.push_back({AddressOf(one->peer), bytes});
  }
  for (const ConnectionCut& cut : CutsAmong(bounded, bounds)) {
    CutOff(*connections[cut.connection], cut.sent_too_much, now_ns, lines);
  }
}

// It is seen to have ended in the next review.
void ConnectionWatch::CutOff(const Connection& connection, bool sent_too_much, std::int64_t now_ns,
                             std::vector<std::string>& lines) {
  shutdown(connection.fd, SHUT_RDWR);
  if (sent_too_much) kept_out_[AddressOf(connection.peer)] = now_ns + kOutsideNs;
  const auto left_out = log_budget_.Take(connection.peer, now_ns);
  if (!left_out) return;
  const bool is_known = !connection.identity.empty();
  lines.push_back("cut off " + (is_known ? connection.identity + " at " : std::string()) +
                  connection.peer + ": " + ReasonFor(is_known, sent_too_much) +
                  (*left_out == 0 ? "" : " (and " + std::to_string(*left_out) + " more since)"));
}

}  // namespace palpate
