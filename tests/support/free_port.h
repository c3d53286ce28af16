// A port of this machine for a test's own server.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <random>

namespace palpate::test {

// Not one of the ports that the kernel gives to connections (32768 and up): another test's
// connection may take such a port before it is used.
inline int FreePort() {
  std::random_device random;
  std::uniform_int_distribution<int> ports(10000, 32767);
  while (true) {
    const int port = ports(random);
    const int probe = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<in_port_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const bool is_free = bind(probe, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
    close(probe);
    if (is_free) return port;
  }
}

}  // namespace palpate::test
