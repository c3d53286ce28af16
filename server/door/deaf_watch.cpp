#include "server/door/deaf_watch.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <system_error>

#include "server/log/log.h"

namespace palpate {
namespace {

bool IsFull(const pollfd& looked_at) {
  int unread_bytes = 0;
  ioctl(looked_at.fd, FIONREAD, &unread_bytes);
  return (looked_at.revents & POLLOUT) == 0 || unread_bytes >= DeafWatch::kFullBytes;
}

}  // namespace

DeafWatch::~DeafWatch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  for (const Connection& one : connections_) close(one.fd);
}

bool DeafWatch::Enter(int fd) {
  const std::lock_guard lock(mutex_);
  try {
    if (!thread_.joinable()) thread_ = std::thread([this] { Run(); });
  } catch (const std::system_error&) {
    return false;  // too many threads
  }
  const int second_fd = fcntl(fd, F_DUPFD_CLOEXEC, first_file_);
  if (second_fd < 0) return false;
  connections_.push_back({second_fd});
  changed_.notify_all();
  return true;
}

void DeafWatch::Run() {
  pthread_setname_np(pthread_self(), "palpate-deaf");
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return stop_ || !connections_.empty(); });
    if (changed_.wait_for(lock, kLookTime, [this] { return stop_; })) return;
    if (const std::size_t cut = Look(); cut > 0) {
      lock.unlock();  // the acceptor needs it
      LogOfClient(LogLevel::kWarning, "cut off",
                  "cut off {} clients of {}: they call without waiting for answers", cut, socket_);
      lock.lock();
    }
  }
}

std::size_t DeafWatch::Look() {
  std::vector<pollfd> files;
  for (const Connection& one : connections_) files.push_back({one.fd, POLLOUT, 0});
  poll(files.data(), files.size(), 0);
  const bool are_many = calls_ > kManyCalls;
  std::size_t cut = 0;
  std::size_t left = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    Connection one = connections_[i];
    if ((files[i].revents & (POLLHUP | POLLERR)) != 0) {
      close(one.fd);
      continue;
    }
    one.full_looks = IsFull(files[i]) ? one.full_looks + 1 : 0;
    if (are_many && one.full_looks >= kFullLooks) {
      shutdown(one.fd, SHUT_RDWR);
      ++cut;
    }
    connections_[left++] = one;
  }
  connections_.resize(left);
  return cut;
}

}  // namespace palpate
