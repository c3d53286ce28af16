// Who shares what is scarce: networks. Logins are cheap for whoever has the room's key, and so are
// addresses for an IPv6 host. A network may hold all while nobody else wants it, for a lecture hall
// behind one NAT is one network.
//
// Threads: any. Pure.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate::web {

// The network of an address: the address itself (also of IPv4 in IPv6), or its /64 of IPv6.
std::string NetworkOf(const std::string& address);

// Of these networks, one for each holder, the one that is named most often. Of equal ones, the
// first. "" for none.
std::string_view NetworkWithMost(const std::vector<std::string_view>& networks);

// Which holder, the oldest first, gives way to one more of `network`: the newest of the network
// that has most. Null: `network` would then have as many.
std::optional<std::size_t> WhoGivesWay(std::vector<std::string_view> networks,
                                       std::string_view network);

}  // namespace palpate::web
