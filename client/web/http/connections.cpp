#include "client/web/http/connections.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/network_v6.hpp>
#include <boost/system/error_code.hpp>
#include <map>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

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

Connections::Connections(int most, int most_strangers)
    : most_(most), most_strangers_(most_strangers) {}

std::unique_ptr<Connections::Ticket> Connections::Admit(std::string network) {
  const bool has_room =
      strangers_ < most_strangers_ && (count() < most_ || CloseOneOfTheGreediest(network));
  if (!has_room && !CloseOneStranger(network)) return nullptr;
  std::unique_ptr<Ticket> ticket(new Ticket(*this, std::move(network)));
  ticket->place_ = open_.insert(open_.end(), ticket.get());
  ++strangers_;
  return ticket;
}

void Connections::CloseAll() {
  while (!open_.empty()) Close(*open_.front());
}

bool Connections::CloseOneStranger(const std::string& newcomer) {
  std::vector<std::string_view> networks;
  for (const Ticket* ticket : open_) {
    if (!ticket->session_) networks.push_back(ticket->peer);
  }
  networks.push_back(newcomer);
  const std::string_view most = NetworkWithMost(networks);
  const auto oldest = std::find_if(open_.begin(), open_.end(), [&](const Ticket* ticket) {
    return !ticket->session_ && ticket->peer == most;
  });
  if (oldest == open_.end()) return false;
  Close(**oldest);
  return true;
}

bool Connections::CloseOneOfTheGreediest(const std::string& newcomer) {
  const auto counts = [](const Ticket* ticket) {
    return ticket->session_ != nullptr && ticket->use != Ticket::Use::kWebSocket;
  };
  std::map<SessionPtr, int> of_session;
  std::map<std::string_view, int> of_network;
  for (const Ticket* ticket : open_) {
    if (!counts(ticket)) continue;
    ++of_session[ticket->session_];
    ++of_network[ticket->network()];
  }
  Ticket* found = nullptr;
  std::tuple<int, bool, int> most{};
  for (Ticket* ticket : open_) {
    if (!counts(ticket)) continue;
    const bool is_idle = ticket->use == Ticket::Use::kIdle;
    const std::tuple rank(of_network[ticket->network()], is_idle, of_session[ticket->session_]);
    const bool may_close =
        is_idle || std::get<2>(rank) > kMostInUse || std::get<0>(rank) > of_network[newcomer] + 1;
    if (!may_close || rank <= most) continue;
    found = ticket;
    most = rank;
  }
  if (found != nullptr) Close(*found);
  return found != nullptr;
}

// By a copy: closing may destroy the ticket.
void Connections::Close(Ticket& ticket) {
  ticket.Leave();
  const std::function<void()> close = std::move(ticket.close);
  if (close) close();
}

void Connections::Ticket::LoggedIn(SessionPtr session) {
  if (connections_ != nullptr && !session_) --connections_->strangers_;
  session_ = std::move(session);
}

void Connections::Ticket::Leave() {
  if (connections_ == nullptr) return;
  if (!session_) --connections_->strangers_;
  connections_->open_.erase(place_);
  connections_ = nullptr;
}

}  // namespace palpate::web
