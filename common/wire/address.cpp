#include "common/wire/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <filesystem>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr std::string_view kSocketName = "/palpated.sock";
constexpr std::string_view kSuffix = ".sock";
// With a socket beside the usual one, highest first.
constexpr Role kLowerRoles[] = {Role::kOperator, Role::kEditor, Role::kViewer};

std::string EnvironmentValue(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

bool IsAlphanumeric(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
}

// "a-word.sock" for "a.sock", "a-word" for "a".
std::string Beside(const std::string& path, std::string_view word) {
  const bool has_suffix = path.ends_with(kSuffix);
  const std::string base = path.substr(0, path.size() - (has_suffix ? kSuffix.size() : 0));
  return base + "-" + std::string(word) + std::string(has_suffix ? kSuffix : "");
}

bool MayOpen(const std::string& path) { return access(path.c_str(), W_OK) == 0; }

// Any user may create a folder in /tmp. A folder that is not ours alone could be a trap.
std::string TemporaryFolder() {
  const std::string folder = "/tmp/palpate-" + std::to_string(getuid());
  struct stat info {};
  if (lstat(folder.c_str(), &info) == 0 &&
      (!S_ISDIR(info.st_mode) || info.st_uid != getuid() || (info.st_mode & 022) != 0)) {
    throw Error(ErrorKind::kPermissionDenied,
                folder +
                    " is not a folder that only you can write: remove it, or name the socket "
                    "with --socket or PALPATE_SOCKET");
  }
  return folder;
}

void CheckHost(const std::string& host, bool bracketed, const std::string& text) {
  if (bracketed) {
    in6_addr address{};
    if (inet_pton(AF_INET6, host.c_str(), &address) != 1) {
      Refuse("'" + text + "': '" + host + "' is not an IPv6 address");
    }
    return;
  }
  if (host.find(':') != std::string::npos) {
    Refuse("'" + text + "': write an IPv6 address in brackets, as in [::1]:7400");
  }
  const bool valid = !host.empty() && host.size() <= 253 && host.front() != '-' &&
                     std::all_of(host.begin(), host.end(), [](char c) {
                       return IsAlphanumeric(c) || c == '.' || c == '-' || c == '_';
                     });
  if (!valid) {
    Refuse("'" + text + "' is not an address: expected HOST:PORT, as in localhost:7400");
  }
}

}  // namespace

std::string DefaultSocketPath(const std::string& system_folder) {
  if (std::string path = EnvironmentValue("PALPATE_SOCKET"); !path.empty()) {
    return path;
  }
  const std::string name(kSocketName);
  struct stat info {};
  const bool is_folder = stat(system_folder.c_str(), &info) == 0 && S_ISDIR(info.st_mode);
  if (is_folder && (access(system_folder.c_str(), W_OK | X_OK) == 0 ||
                    MayOpen(HighestSocketPath(system_folder + name)))) {
    return system_folder + name;
  }
  if (const std::string folder = EnvironmentValue("XDG_RUNTIME_DIR"); !folder.empty()) {
    return folder + "/palpate" + name;
  }
  return TemporaryFolder() + name;
}

std::string UnixTarget(const std::string& path) {
  if (path.empty()) {
    Refuse("the path of the socket is empty");
  }
  const std::string absolute = std::filesystem::absolute(path).string();
  if (absolute.size() > kMaxSocketPathLength) {
    Refuse("the path of a socket has at most " + std::to_string(kMaxSocketPathLength) +
           " bytes, this one has " + std::to_string(absolute.size()) + ": " + absolute);
  }
  // A gRPC client decodes its target as a URI, a gRPC server does not. Only these characters mean
  // the same to both.
  const auto is_plain = [](char c) {
    return IsAlphanumeric(c) || std::string_view("/-._~+=,:@").find(c) != std::string_view::npos;
  };
  if (!std::all_of(absolute.begin(), absolute.end(), is_plain)) {
    Refuse("the path of a socket may hold letters, digits and /-._~+=,:@ only: " + absolute);
  }
  return "unix:" + absolute;
}

std::string RoleSocketPath(const std::string& usual_path, Role role) {
  return role == Role::kAdmin ? usual_path : Beside(usual_path, NameOf(role));
}

std::string UsualSocketPath(const std::string& path) {
  for (const Role role : kLowerRoles) {
    for (const std::string_view suffix : {kSuffix, std::string_view()}) {
      const std::string end = "-" + std::string(NameOf(role)) + std::string(suffix);
      if (path.ends_with(end)) {
        return path.substr(0, path.size() - end.size()) + std::string(suffix);
      }
    }
  }
  return path;
}

std::string DoorSocketPath(const std::string& usual_path, Role role) {
  return Beside(usual_path, "door-" + std::string(NameOf(role)));
}

std::string DoorStopPath(const std::string& usual_path) { return Beside(usual_path, "door-stop"); }

std::string HighestSocketPath(const std::string& usual_path) {
  if (MayOpen(usual_path)) return usual_path;
  for (const Role role : kLowerRoles) {
    if (std::string path = RoleSocketPath(usual_path, role); MayOpen(path)) return path;
  }
  return usual_path;
}

std::string StopSocketPath(const std::string& socket_path) { return Beside(socket_path, "stop"); }

std::string FindStopSocket(const std::string& socket_path) {
  const std::string own = StopSocketPath(socket_path);
  return access(own.c_str(), F_OK) == 0 ? own : StopSocketPath(UsualSocketPath(socket_path));
}

std::string HostPort::ToString() const {
  const bool is_ipv6 = host.find(':') != std::string::npos;
  return (is_ipv6 ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

HostPort ParseHostPort(std::string_view text) {
  const std::string quoted(text);
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) {
    Refuse("'" + quoted + "' names no port: expected HOST:PORT, as in localhost:7400");
  }
  std::string_view host = text.substr(0, colon);
  const std::string_view digits = text.substr(colon + 1);
  const bool bracketed = host.size() >= 2 && host.front() == '[' && host.back() == ']';
  if (bracketed) {
    host = host.substr(1, host.size() - 2);
  }
  HostPort address;
  address.host = std::string(host);
  CheckHost(address.host, bracketed, quoted);
  const char* end = digits.data() + digits.size();
  const auto [stop, error] = std::from_chars(digits.data(), end, address.port);
  if (error != std::errc() || stop != end || address.port == 0) {
    Refuse("'" + quoted + "': the port is a number from 1 to 65535");
  }
  return address;
}

bool IsLoopback(const HostPort& address) {
  in_addr v4{};
  in6_addr v6{};
  if (inet_pton(AF_INET, address.host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
  return inet_pton(AF_INET6, address.host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

std::string TcpTarget(const HostPort& address) {
  // With the scheme, a host called "unix" is not taken for a scheme.
  if (address.host.find(':') != std::string::npos) {
    return "ipv6:%5B" + address.host + "%5D:" + std::to_string(address.port);
  }
  return "dns:///" + address.ToString();
}

}  // namespace palpate
