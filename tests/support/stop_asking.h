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
  // The kernel may refuse to pass it.
  void SendFile(std::string_view text, int file) const {
    iovec bytes{const_cast<char*>(text.data()), text.size()};
    alignas(cmsghdr) char passed[CMSG_SPACE(sizeof(file))] = {};
    msghdr message{};
    message.msg_iov = &bytes;
    message.msg_iovlen = 1;
    message.msg_control = passed;
    message.msg_controllen = sizeof(passed);
    cmsghdr* const header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof(file));
    std::memcpy(CMSG_DATA(header), &file, sizeof(file));
    sendmsg(fd_, &message, MSG_NOSIGNAL);
  }
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
