// The open sockets, and how many there may be.
//
// Sockets without a login are few: for a new one, the oldest of them is closed. So a flood of
// connections costs a bounded amount, and a guest still gets in. If all sockets are taken, the
// session that has the most loses one that it does not use.
//
// Threads: one.
#pragma once

#include <cstddef>
#include <functional>
#include <list>
#include <memory>

#include "client/web/access/sessions.h"

namespace palpate::web {

class Connections {
 public:
  // One open socket, as long as it lives. Must not outlive Connections.
  class Ticket {
   public:
    ~Ticket() { Leave(); }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;

    void LoggedIn(SessionPtr session);
    // An idle socket waits for a request: its browser loses nothing if it is closed.
    enum class Use { kIdle, kRequest, kWebSocket };
    Use use = Use::kIdle;
    // Closes the socket. The socket then no longer counts.
    std::function<void()> close;

   private:
    friend class Connections;
    explicit Ticket(Connections& connections) : connections_(&connections) {}
    void Leave();

    Connections* connections_;  // null: does not count
    std::list<Ticket*>::iterator place_;
    SessionPtr session_;  // null: a stranger
  };

  Connections(int most, int most_strangers);

  // More than a browser opens, besides WebSockets: a session's next ones need not be idle.
  static constexpr int kMostInUse = 16;

  // Null: there are as many as may be, all of them logged in and in use.
  std::unique_ptr<Ticket> Admit();
  void CloseAll();

  int count() const { return static_cast<int>(open_.size()); }
  int strangers() const { return strangers_; }

 private:
  bool CloseOldestStranger();
  bool CloseOneOfTheGreediest();
  static void Close(Ticket& ticket);

  const int most_, most_strangers_;
  std::list<Ticket*> open_;  // oldest first
  int strangers_ = 0;
};

}  // namespace palpate::web
