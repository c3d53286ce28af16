#include "client/cli/doctor/ports.h"

#include <arpa/inet.h>
#include <fmt/core.h>
#include <netdb.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <memory>
#include <optional>
#include <set>
#include <sstream>

namespace palpate::doctor {
namespace {

namespace fs = std::filesystem;

constexpr char kConfig[] = "etc/palpate/palpated.toml";
constexpr int kPatienceMs = 2000;

// A place where palpated may listen.
struct Place {
  const char* check;  // name of the finding
  std::string section;
  std::string default_address;
};

struct Listener {
  std::string host;  // as a client on this machine reaches the place
  std::uint16_t port = 0;
  std::string inode;
  std::string user;
};

// Reads an address such as "0100007F": words of four bytes, each in this machine's byte order.
std::string HostOf(const std::string& hexadecimal) {
  std::array<std::uint32_t, 4> words{};
  const std::size_t count = std::min(hexadecimal.size() / 8, words.size());
  for (std::size_t n = 0; n < count; ++n) {
    const char* word = hexadecimal.data() + 8 * n;
    std::from_chars(word, word + 8, words[n], 16);
  }
  char text[INET6_ADDRSTRLEN] = "";
  inet_ntop(count == 1 ? AF_INET : AF_INET6, words.data(), text, sizeof(text));
  return count == 1 ? text : "[" + std::string(text) + "]";
}

// Returns the listening sockets of /proc/net/tcp. Addresses and ports are hexadecimal there; state
// 0A means listening.
std::vector<Listener> Listeners(const Workstation& machine) {
  std::vector<Listener> listeners;
  for (const char* table : {"proc/net/tcp", "proc/net/tcp6"}) {
    std::ifstream file(machine.root / table);
    for (std::string line; std::getline(file, line);) {
      std::istringstream fields(line);
      std::string number, local, remote, state, queues, timer, retries, user, timeout, inode;
      fields >> number >> local >> remote >> state >> queues >> timer >> retries >> user >>
          timeout >> inode;
      if (state != "0A" || local.size() < 4) continue;
      std::uint16_t port = 0;
      std::from_chars(local.data() + local.size() - 4, local.data() + local.size(), port, 16);
      listeners.push_back({HostOf(local.substr(0, local.find(':'))), port, inode, user});
    }
  }
  return listeners;
}

std::optional<Listener> FindListener(const Workstation& machine, std::uint16_t port) {
  for (const Listener& listener : Listeners(machine)) {
    if (listener.port == port) return listener;
  }
  return std::nullopt;
}

bool Holds(const fs::path& process, const std::string& inode) {
  std::error_code error;
  fs::directory_iterator file(process / "fd", error);
  for (; !error && file != fs::directory_iterator(); file.increment(error)) {
    std::error_code gone;
    if (fs::read_symlink(file->path(), gone) == "socket:[" + inode + "]") return true;
  }
  return false;
}

// Returns the program's name, or "" if the program belongs to another user.
std::string HolderOf(const Workstation& machine, const std::string& inode) {
  std::error_code error;
  fs::directory_iterator process(machine.root / "proc", error);
  for (; !error && process != fs::directory_iterator(); process.increment(error)) {
    if (!Holds(process->path(), inode)) continue;
    std::ifstream file(process->path() / "comm");
    std::string name;
    std::getline(file, name);
    return name;
  }
  return "";
}

std::string AddressOf(const Workstation& machine, const Place& place) {
  return Configured(machine, place.section, "listen").value_or(place.default_address);
}

// Returns 0 if the address has no port.
std::uint16_t PortOf(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  const std::string digits = colon == address.npos ? "" : address.substr(colon + 1);
  std::uint16_t port = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), port);
  return port;
}

Place ServerPlace() { return {"port", "server", "127.0.0.1:7400"}; }
Place MetricsPlace() { return {"metrics", "metrics", "127.0.0.1:9464"}; }

Finding Answering(const std::string& address, const char* check = "port") {
  return {check, Verdict::kOk, address + ": palpated answers"};
}
Finding Silent(const std::string& address, const char* check = "port") {
  return {check, Verdict::kFail, address + ": palpated has it, and does not answer",
          "see systemctl status palpated; journalctl -u palpated"};
}

Finding Check(const Workstation& machine, const Place& place) {
  const bool configured = Configured(machine, place.section, "listen").has_value();
  const std::string address = AddressOf(machine, place);
  const std::uint16_t port = PortOf(address);
  if (port == 0) {
    return {place.check, Verdict::kFail, address + " is no address and port",
            "correct listen in [" + place.section + "] of /" + kConfig};
  }
  const auto listener = FindListener(machine, port);
  if (!listener) {
    return {place.check, Verdict::kOk,
            address + " is free" + (configured ? "" : ", and listen is not set")};
  }
  const std::string holder = HolderOf(machine, listener->inode);
  if (holder == "palpated") {
    const std::string host = address.substr(0, address.rfind(':'));
    return machine.answers(host, port) ? Answering(address, place.check)
                                       : Silent(address, place.check);
  }
  if (holder.empty()) {
    return {place.check, Verdict::kWarn,
            address + " is taken by a program of the user with the number " + listener->user,
            "run this as root to see by which; it may be palpated itself"};
  }
  return {place.check, configured ? Verdict::kFail : Verdict::kWarn,
          address + " is taken by " + holder,
          "end that, or set another listen in [" + place.section + "] of /" + kConfig};
}

// A server that listens on all addresses is also reached on this machine's own.
std::string ReachedBy(std::string host) {
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  if (host == "0.0.0.0") return "127.0.0.1";
  return host == "::" ? "::1" : host;
}

// The first message of TLS. Returns "" if OpenSSL has no memory.
std::string ClientHello() {
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context(SSL_CTX_new(TLS_client_method()),
                                                                  SSL_CTX_free);
  const std::unique_ptr<SSL, decltype(&SSL_free)> ssl(context ? SSL_new(context.get()) : nullptr,
                                                      SSL_free);
  BIO* received = BIO_new(BIO_s_mem());
  BIO* sent = BIO_new(BIO_s_mem());
  if (!ssl || !received || !sent) return "";
  SSL_set_bio(ssl.get(), received, sent);  // owns both
  SSL_connect(ssl.get());                  // ends where it waits for the server's answer
  char* hello = nullptr;
  const long size = BIO_get_mem_data(sent, &hello);
  return {hello, static_cast<std::size_t>(size)};
}

}  // namespace

Finding CheckPort(const Workstation& machine) { return Check(machine, ServerPlace()); }

Finding CheckMetricsPort(const Workstation& machine) { return Check(machine, MetricsPlace()); }

std::vector<Finding> CheckDaemonPorts(const Workstation& machine) {
  std::set<std::uint16_t> checked{PortOf(AddressOf(machine, ServerPlace())),
                                  PortOf(AddressOf(machine, MetricsPlace()))};
  std::vector<Finding> findings;
  for (const Listener& listener : Listeners(machine)) {
    if (checked.contains(listener.port) || HolderOf(machine, listener.inode) != "palpated")
      continue;
    checked.insert(listener.port);
    const std::string address = listener.host + ":" + std::to_string(listener.port);
    findings.push_back(machine.answers(listener.host, listener.port) ? Answering(address)
                                                                     : Silent(address));
  }
  return findings;
}

bool Answers(const std::string& host, std::uint16_t port) {
  const std::string hello = ClientHello();
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (getaddrinfo(ReachedBy(host).c_str(), std::to_string(port).c_str(), &hints, &found) != 0) {
    return false;
  }
  const int fd = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  connect(fd, found->ai_addr, found->ai_addrlen);
  freeaddrinfo(found);
  const auto becomes = [fd](short event) {
    pollfd file{fd, event, 0};
    return poll(&file, 1, kPatienceMs) == 1 && (file.revents & event) != 0;
  };
  char byte = 0;
  const bool answers =
      becomes(POLLOUT) &&
      send(fd, hello.data(), hello.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(hello.size()) &&
      becomes(POLLIN) && recv(fd, &byte, 1, 0) == 1;
  close(fd);
  return answers;
}

}  // namespace palpate::doctor
