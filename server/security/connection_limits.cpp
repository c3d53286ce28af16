#include "server/security/connection_limits.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <map>
#include <string_view>

namespace palpate {

std::vector<std::size_t> CutsAmong(std::span<const std::string> prefixes, std::size_t most) {
  std::map<std::string_view, std::vector<std::size_t>> groups;  // by prefix; the oldest last
  for (std::size_t n = prefixes.size(); n-- > 0;) groups[prefixes[n]].push_back(n);
  std::vector<std::size_t> cuts;
  while (prefixes.size() - cuts.size() > most) {
    // Of the prefix with the most connections. Among equal ones, of that with the oldest.
    auto& [prefix, group] = *std::ranges::max_element(groups, [](const auto& a, const auto& b) {
      return a.second.size() != b.second.size() ? a.second.size() < b.second.size()
                                                : a.second.back() > b.second.back();
    });
    cuts.push_back(group.back());
    group.pop_back();
    if (group.empty()) groups.erase(prefix);
  }
  return cuts;
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
