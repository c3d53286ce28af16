#include "server/rpc/stranger_watch.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/tcp.h>
#include <netinet/in.h>
#include <pthread.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>

#include "server/realtime/thread_setup.h"
#include "server/realtime/tick_timer.h"
#include "server/security/stranger_limits.h"

namespace palpate {
namespace {

// Of <netinet/tcp.h>, which cannot stand beside <linux/tcp.h>.
constexpr int kEstablished = 1;
constexpr int kPriority = 1;

// Negative: it has ended.
std::int64_t ReceivedBytes(int fd) {
  tcp_info info{};
  socklen_t size = sizeof(info);
  if (getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &size) != 0) return -1;
  if (info.tcpi_state != kEstablished) return -1;
  return static_cast<std::int64_t>(info.tcpi_bytes_received);
}

std::string NameOf(const in_addr& address, std::uint16_t port) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address, text, sizeof(text));
  return std::string("ipv4:") + text + ":" + std::to_string(ntohs(port));
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

StrangerWatch::~StrangerWatch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  for (const Stranger& stranger : strangers_) close(stranger.fd);
}

bool StrangerWatch::Enter(int fd, const sockaddr_storage& peer) {
  const std::lock_guard lock(mutex_);
  Stranger stranger{.peer = PeerName(peer)};
  const auto outside = kept_out_.find(AddressOf(stranger.peer));
  if (outside != kept_out_.end()) {
    if (MonotonicNowNs() < outside->second) return false;
    kept_out_.erase(outside);
  }
  stranger.fd = fcntl(fd, F_DUPFD_CLOEXEC, 0);
  if (stranger.fd < 0) return false;
  strangers_.push_back(std::move(stranger));
  if (!thread_.joinable()) thread_ = std::thread([this] { Run(); });
  changed_.notify_all();
  return true;
}

void StrangerWatch::Admitted(const std::string& peer) {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(strangers_.begin(), strangers_.end(),
                                  [&](const Stranger& one) { return one.peer == peer; });
  if (found == strangers_.end()) return;
  close(found->fd);
  strangers_.erase(found);
}

void StrangerWatch::Run() {
  // Far below the servo, and before all that strangers keep busy: what they send until the
  // next look must not depend on it.
  RealtimeGrant grant;
  SetupRealtimeThread({.priority = kPriority, .lock_memory = false}, grant);
  pthread_setname_np(pthread_self(), "palpate-watch");
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (strangers_.empty()) {
      changed_.wait(lock);
    } else {
      changed_.wait_for(lock, kReviewTime, [this] { return stop_; });
    }
    const std::vector<std::string> lines = Review();
    lock.unlock();
    for (const std::string& line : lines) spdlog::warn("{}", line);
    lock.lock();
  }
}

std::vector<std::string> StrangerWatch::Review() {
  std::vector<std::string> lines;
  std::vector<StrangerConnection> connections;
  std::erase_if(strangers_, [&](const Stranger& stranger) {
    const std::int64_t bytes = ReceivedBytes(stranger.fd);
    if (bytes < 0) {
      close(stranger.fd);
      return true;
    }
    connections.push_back({AddressOf(stranger.peer), bytes});
    return false;
  });
  for (const StrangerCut& cut : CutsAmongStrangers(connections)) {
    CutOff(strangers_[cut.connection], cut.sent_too_much, lines);
  }
  const std::int64_t now_ns = MonotonicNowNs();
  std::erase_if(kept_out_, [&](const auto& address) { return address.second <= now_ns; });
  return lines;
}

// It is seen to have ended in the next review.
void StrangerWatch::CutOff(const Stranger& stranger, bool sent_too_much,
                           std::vector<std::string>& lines) {
  shutdown(stranger.fd, SHUT_RDWR);
  const std::int64_t now_ns = MonotonicNowNs();
  if (sent_too_much) kept_out_[AddressOf(stranger.peer)] = now_ns + kOutsideNs;
  const auto left_out = log_budget_.Take(stranger.peer, now_ns);
  if (!left_out) return;
  lines.push_back(
      "cut off " + stranger.peer + ": " +
      (sent_too_much ? "it sent too much without a call that it may make; its address is kept out "
                       "for 10 s"
                     : "too many are connected without a call that they may make") +
      (*left_out == 0 ? "" : " (and " + std::to_string(*left_out) + " more since)"));
}

}  // namespace palpate
