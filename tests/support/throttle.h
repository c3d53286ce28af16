// A slow link to a port of this machine: all connections through it share so many bytes a second,
// and each holds back who sends too much. Threads: its own.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <list>
#include <mutex>
#include <thread>

#include "tests/support/free_port.h"

namespace palpate::test {

class Throttle {
 public:
  Throttle(int to_port, double bytes_per_s) : to_port_(to_port), bytes_per_s_(bytes_per_s) {
    const sockaddr_in address = Address(port_);
    const int on = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    // Inherited by the connections: no long queue before the link.
    setsockopt(listener_, SOL_SOCKET, SO_RCVBUF, &kBufferBytes, sizeof(kBufferBytes));
    bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
    listen(listener_, 16);
    accepting_ = std::thread([this] { Accept(); });
  }
  // End the connections first.
  ~Throttle() {
    shutdown(listener_, SHUT_RDWR);
    accepting_.join();
    close(listener_);
    for (std::thread& pump : pumps_) pump.join();
  }
  int port() const { return port_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr int kBufferBytes = 32 << 10;

  static sockaddr_in Address(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
  }

  void Accept() {
    for (int near = 0; (near = accept(listener_, nullptr, nullptr)) >= 0;) {
      const int far = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
      const sockaddr_in address = Address(to_port_);
      connect(far, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
      pumps_.emplace_back([=, this] { Carry(near, far); });
      pumps_.emplace_back([=, this] { Carry(far, near); });
    }
  }

  void Carry(int from, int to) {
    std::array<char, 4096> bytes;
    for (ssize_t count = 0; (count = recv(from, bytes.data(), bytes.size(), 0)) > 0;) {
      std::this_thread::sleep_until(Turn(static_cast<double>(count)));
      if (send(to, bytes.data(), static_cast<std::size_t>(count), MSG_NOSIGNAL) != count) break;
    }
    shutdown(from, SHUT_RDWR);
    shutdown(to, SHUT_RDWR);
  }

  // When the link is free for these bytes.
  Clock::time_point Turn(double bytes) {
    const std::lock_guard lock(mutex_);
    const Clock::time_point turn = std::max(Clock::now(), free_);
    free_ = turn + std::chrono::duration_cast<Clock::duration>(
                       std::chrono::duration<double>(bytes / bytes_per_s_));
    return turn;
  }

  const int port_ = FreePort();
  const int to_port_;
  const double bytes_per_s_;
  const int listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  std::mutex mutex_;
  Clock::time_point free_{};
  std::list<std::thread> pumps_;
  std::thread accepting_;
};

}  // namespace palpate::test
