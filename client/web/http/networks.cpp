#include "client/web/http/networks.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/network_v6.hpp>
#include <boost/system/error_code.hpp>
#include <map>

namespace palpate::web {
namespace {

namespace ip = boost::asio::ip;

}  // namespace

std::string NetworkOf(const std::string& address) {
  boost::system::error_code problem;
  const auto parsed = ip::make_address(address, problem);
  if (problem || !parsed.is_v6()) return address;
  const ip::address_v6 v6 = parsed.to_v6();
  if (v6.is_v4_mapped()) return ip::make_address_v4(ip::v4_mapped, v6).to_string();
  return ip::network_v6(v6, 64).canonical().to_string();
}

std::string_view NetworkWithMost(const std::vector<std::string_view>& networks) {
  std::map<std::string_view, int> counts;
  std::string_view with_most;
  for (const std::string_view network : networks) ++counts[network];
  for (const std::string_view network : networks) {
    if (counts[network] > counts[with_most]) with_most = network;
  }
  return with_most;
}

std::optional<std::size_t> WhoGivesWay(std::vector<std::string_view> networks,
                                       std::string_view network) {
  networks.push_back(network);
  const std::string_view most = NetworkWithMost(networks);
  if (std::count(networks.begin(), networks.end(), most) <=
      std::count(networks.begin(), networks.end(), network)) {
    return std::nullopt;
  }
  const auto newest = std::find(networks.rbegin(), networks.rend(), most);
  return static_cast<std::size_t>(networks.rend() - newest) - 1;
}

}  // namespace palpate::web
