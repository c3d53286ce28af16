#include "client/web/http/connections.h"

#include <algorithm>
#include <map>
#include <utility>

namespace palpate::web {

Connections::Connections(int most, int most_strangers)
    : most_(most), most_strangers_(most_strangers) {}

std::unique_ptr<Connections::Ticket> Connections::Admit() {
  const bool has_room =
      strangers_ < most_strangers_ && (count() < most_ || CloseOneOfTheGreediest());
  if (!has_room && !CloseOldestStranger()) return nullptr;
  std::unique_ptr<Ticket> ticket(new Ticket(*this));
  ticket->place_ = open_.insert(open_.end(), ticket.get());
  ++strangers_;
  return ticket;
}

void Connections::CloseAll() {
  while (!open_.empty()) Close(*open_.front());
}

bool Connections::CloseOldestStranger() {
  const auto oldest = std::find_if(open_.begin(), open_.end(),
                                   [](const Ticket* ticket) { return !ticket->session_; });
  if (oldest == open_.end()) return false;
  Close(**oldest);
  return true;
}

bool Connections::CloseOneOfTheGreediest() {
  const auto counts = [](const Ticket* ticket) {
    return ticket->session_ != nullptr && ticket->use != Ticket::Use::kWebSocket;
  };
  std::map<SessionPtr, int> counts_of;
  for (const Ticket* ticket : open_) {
    if (counts(ticket)) ++counts_of[ticket->session_];
  }
  Ticket* found = nullptr;
  int most = 0;
  for (Ticket* ticket : open_) {
    if (!counts(ticket)) continue;
    const int count = counts_of[ticket->session_];
    if (count <= most || (ticket->use != Ticket::Use::kIdle && count <= kMostInUse)) continue;
    found = ticket;
    most = count;
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
