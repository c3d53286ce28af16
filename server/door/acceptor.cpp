#include "server/door/acceptor.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>

#include "common/error/error.h"
#include "common/files/bound_socket.h"
#include "server/log/log.h"

namespace palpate {
namespace {

constexpr int kWaiting = 256;
// Waits this long if no file number is free, to avoid a busy loop.
constexpr int kPauseMs = 100;
// The time that gRPC waits for silent peers.
constexpr unsigned kSilentPeerMs = 30'000;

[[noreturn]] void FailToListen(int fd, const std::string& name, const std::string& option) {
  const std::string why = std::strerror(errno);
  if (fd >= 0) close(fd);
  throw Error(ErrorKind::kConflict,
              "cannot listen on " + name + ": " + why + "; name another with " + option);
}

sockaddr_storage Parse(const HostPort& address) {
  sockaddr_storage parsed{};
  auto& v4 = reinterpret_cast<sockaddr_in&>(parsed);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(parsed);
  const bool is_v6 = address.host.find(':') != std::string::npos;
  parsed.ss_family = is_v6 ? AF_INET6 : AF_INET;
  (is_v6 ? v6.sin6_port : v4.sin_port) = htons(address.port);
  void* const number = is_v6 ? static_cast<void*>(&v6.sin6_addr) : &v4.sin_addr;
  if (inet_pton(parsed.ss_family, address.host.c_str(), number) == 1) return parsed;
  Refuse("cannot listen on " + address.ToString() + ": give an address, and not a name");
}

}  // namespace

void Acceptor::TakeSocket(const std::string& path, mode_t mode, std::optional<gid_t> group,
                          DeafWatch* deaf_watch) {
  listener_ = BindSocket(path, mode);
  if (listener_ < 0) FailToListen(-1, path, "--socket");
  if (group) GiveToGroup(path, *group);  // nobody can connect yet
  name_ = path;
  deaf_watch_ = deaf_watch;
}

void CheckAddress(const HostPort& address) { Parse(address); }

void Acceptor::TakePort(const HostPort& address, std::optional<Role> loopback_role) {
  const sockaddr_storage parsed = Parse(address);
  const int fd = socket(parsed.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;
  // Lets a restarted daemon bind while connections of the previous daemon still end.
  setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  const int bound = bind(fd, reinterpret_cast<const sockaddr*>(&parsed), sizeof(parsed));
  if (fd < 0 || bound != 0) FailToListen(fd, address.ToString(), "--listen");
  listener_ = fd;
  name_ = address.ToString();
  loopback_role_ = loopback_role;
}

void Acceptor::Start(Sink sink) {
  if (listen(listener_, kWaiting) != 0) FailToListen(-1, name_, "--listen or --socket");
  sink_ = std::move(sink);
  wake_fd_ = eventfd(0, EFD_CLOEXEC);
  if (wake_fd_ < 0) {
    throw Error(ErrorKind::kInternal, "no file is left: raise LimitNOFILE (ulimit -n)");
  }
  thread_ = std::thread([this] { Run(); });
}

void Acceptor::Stop() {
  if (thread_.joinable()) {
    eventfd_write(wake_fd_, 1);
    thread_.join();
    close(wake_fd_);
  }
  if (listener_ >= 0) close(std::exchange(listener_, -1));
  sink_.reset();
}

void Acceptor::Run() {
  pthread_setname_np(pthread_self(), "palpate-accept");
  pollfd files[] = {{listener_, POLLIN, 0}, {wake_fd_, POLLIN, 0}};
  while (true) {
    poll(files, std::size(files), -1);
    if (files[1].revents != 0) return;
    if (files[0].revents != 0) Accept();
  }
}

void Acceptor::Accept() {
  sockaddr_storage peer{};
  socklen_t length = sizeof(peer);
  const int fd =
      accept4(listener_, reinterpret_cast<sockaddr*>(&peer), &length, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) {
    if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) {
      poll(nullptr, 0, kPauseMs);
    }
    return;
  }
  if (fd >= first_refused_file_) {
    close(fd);
    // One budget for all, because a flood may come from many addresses.
    LogOfClient(LogLevel::kWarning, "connections",
                "refused a connection from {}: too many are open; see limits.connections",
                peer.ss_family == AF_UNIX ? name_ : PeerName(peer));
    return;
  }
  if (peer.ss_family != AF_UNIX) {
    const int on = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    // gRPC probes silent peers, but not while a message to the peer waits for room.
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &kSilentPeerMs, sizeof(kSilentPeerMs));
  }
  const bool is_watched = peer.ss_family != AF_UNIX ? watch_.Enter(fd, peer, loopback_role_)
                                                    : !deaf_watch_ || deaf_watch_->Enter(fd);
  if (!is_watched) {
    close(fd);
    return;
  }
  grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
  connection.listener_fd = listener_;
  connection.fd = fd;
  sink_->HandleNewConnection(&connection);
}

}  // namespace palpate
