// The open sockets, and how many there may be.
//
// Sockets without a login are few: for a new one, the oldest of the network that has most of them
// is closed. So a flood of connections costs a bounded amount, and a guest still gets in. If all
// sockets are taken, the network that has the most loses one: of its sessions, the one with the
// most. In use it is closed only for a network that has fewer, or if it is one of very many.
//
// Threads: one.
#pragma once

#include <cstddef>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/web/logins/sessions.h"

namespace palpate::web {

// Who shares what is scarce: networks. Logins are cheap for whoever has the room's key, and so are
// addresses for an IPv6 host. A network may hold all while nobody else wants it, for a lecture hall
// behind one NAT is one network.

// The network of an address: the address itself (also of IPv4 in IPv6), or its /64 of IPv6.
std::string NetworkOf(const std::string& address);

// Of these networks, one for each holder, the one that is named most often. Of equal ones, the
// first. "" for none.
std::string_view NetworkWithMost(const std::vector<std::string_view>& networks);

// Which holder, the oldest first, gives way to one more of `network`: the newest of the network
// that has most. Null: `network` would then have as many.
std::optional<std::size_t> WhoGivesWay(std::vector<std::string_view> networks,
                                       std::string_view network);

class Connections {
 public:
  // One open socket, as long as it lives. Must not outlive Connections.
  class Ticket {
   public:
    ~Ticket() { Leave(); }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;

    void LoggedIn(SessionPtr session);
    // The network that the newest request came from; before the first, that of the socket.
    std::string peer;
    // An idle socket waits for a request: its browser loses nothing if it is closed.
    enum class Use { kIdle, kRequest, kWebSocket };
    Use use = Use::kIdle;
    // Closes the socket. The socket then no longer counts.
    std::function<void()> close;

   private:
    friend class Connections;
    Ticket(Connections& connections, std::string network)
        : peer(std::move(network)), connections_(&connections) {}
    const std::string& network() const { return session_ ? session_->network : peer; }
    void Leave();

    Connections* connections_;  // null: does not count
    std::list<Ticket*>::iterator place_;
    SessionPtr session_;  // null: a stranger
  };

  Connections(int most, int most_strangers);

  // More than a browser opens, besides WebSockets: a session's next ones need not be idle.
  static constexpr int kMostInUse = 16;

  // `network`: of the peer. Null: there are as many as may be, all of them logged in and in use.
  std::unique_ptr<Ticket> Admit(std::string network);
  void CloseAll();

  int count() const { return static_cast<int>(open_.size()); }
  int strangers() const { return strangers_; }

 private:
  bool CloseOneStranger(const std::string& newcomer);
  bool CloseOneOfTheGreediest(const std::string& newcomer);
  static void Close(Ticket& ticket);

  const int most_, most_strangers_;
  std::list<Ticket*> open_;  // oldest first
  int strangers_ = 0;
};

}  // namespace palpate::web
