#include "server/security/connection_limits.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <map>
#include <string_view>

namespace palpate {
namespace {

struct Group {
  std::vector<std::size_t> connections{};  // the oldest first
  std::int64_t bytes = 0;
};
using Groups = std::map<std::string_view, Group>;

bool IsOlder(const Group& a, const Group& b) {
  return a.connections.front() < b.connections.front();
}

// The group with the most of `amount`. Among equal groups, the one with the oldest connection.
template <class Amount>
Group& Greatest(Groups& groups, const Amount& amount) {
  return std::max_element(groups.begin(), groups.end(),
                          [&](const auto& a, const auto& b) {
                            const auto of_a = amount(a.second), of_b = amount(b.second);
                            return of_a != of_b ? of_a < of_b : IsOlder(b.second, a.second);
                          })
      ->second;
}

// The remaining connections, by prefix.
class Rest {
 public:
  Rest(std::span<const BoundedConnection> connections, const ConnectionBounds& bounds)
      : connections_(connections) {
    for (std::size_t n = 0; n < connections.size(); ++n) {
      if (connections[n].bytes > bounds.bytes_of_one) {
        cuts_.push_back({n, true});
        continue;
      }
      Group& group = groups_[connections[n].prefix];
      group.connections.push_back(n);
      group.bytes += connections[n].bytes;
      bytes_ += connections[n].bytes;
      ++count_;
    }
  }

  std::int64_t bytes() const { return bytes_; }
  std::size_t count() const { return count_; }
  std::vector<ConnectionCut> TakeCuts() { return std::move(cuts_); }

  // Cuts the connection that sent the most, of the prefix that sent the most.
  void CutGreatest() {
    Group& group = Greatest(groups_, [](const Group& one) { return one.bytes; });
    const auto most = std::max_element(group.connections.begin(), group.connections.end(),
                                       [&](std::size_t a, std::size_t b) {
                                         return connections_[a].bytes < connections_[b].bytes;
                                       });
    Cut(group, most, true);
  }

  // Cuts the oldest connection of the prefix that has the most connections.
  void CutOldest() {
    Group& group = Greatest(groups_, [](const Group& one) { return one.connections.size(); });
    Cut(group, group.connections.begin(), false);
  }

 private:
  void Cut(Group& group, std::vector<std::size_t>::iterator at, bool sent_too_much) {
    const BoundedConnection& connection = connections_[*at];
    cuts_.push_back({*at, sent_too_much});
    --count_;
    bytes_ -= connection.bytes;
    group.bytes -= connection.bytes;
    group.connections.erase(at);
    if (group.connections.empty()) groups_.erase(connection.prefix);
  }

  const std::span<const BoundedConnection> connections_;
  Groups groups_;
  std::int64_t bytes_ = 0;
  std::size_t count_ = 0;
  std::vector<ConnectionCut> cuts_;
};

}  // namespace

std::vector<ConnectionCut> CutsAmong(std::span<const BoundedConnection> connections,
                                     const ConnectionBounds& bounds) {
  Rest rest(connections, bounds);
  while (rest.bytes() > bounds.bytes_of_all) rest.CutGreatest();
  while (rest.count() > bounds.connections) rest.CutOldest();
  return rest.TakeCuts();
}

std::string PrefixOf(const sockaddr_storage& address) {
  char text[INET6_ADDRSTRLEN] = "";
  if (address.ss_family == AF_INET) {
    inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in&>(address).sin_addr, text, sizeof(text));
    return text;
  }
  in6_addr v6 = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  if (IN6_IS_ADDR_V4MAPPED(&v6)) {
    inet_ntop(AF_INET, v6.s6_addr + 12, text, sizeof(text));
    return text;
  }
  std::fill(v6.s6_addr + 8, std::end(v6.s6_addr), std::uint8_t{0});
  inet_ntop(AF_INET6, &v6, text, sizeof(text));
  return std::string(text) + "/64";
}

}  // namespace palpate
