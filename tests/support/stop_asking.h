// A client of the emergency stop's socket that is no library. Threads: one.
#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <string>
#include <string_view>

namespace palpate::test {

class StopAsking {
 public:
  explicit StopAsking(const std::string& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
    is_connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~StopAsking() { close(fd_); }
  StopAsking(const StopAsking&) = delete;
  StopAsking& operator=(const StopAsking&) = delete;

  void Send(std::string_view text) const { send(fd_, text.data(), text.size(), MSG_NOSIGNAL); }
  // Up to the end of the connection.
  std::string Answer() const {
    std::string all;
    char text[256];
    for (ssize_t got = 0; (got = recv(fd_, text, sizeof(text), 0)) > 0;) all.append(text, got);
    return all;
  }
  bool is_connected() const { return is_connected_; }

 private:
  const int fd_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  bool is_connected_ = false;
};

inline std::string AskToStop(const std::string& path) {
  const StopAsking asking(path);
  asking.Send("stop\n");
  return asking.Answer();
}

}  // namespace palpate::test
