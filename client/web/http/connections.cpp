#include "client/web/http/connections.h"

#include <algorithm>
#include <utility>

namespace palpate::web {

Connections::Connections(int most, int most_strangers)
    : most_(most), most_strangers_(most_strangers) {}

std::unique_ptr<Connections::Ticket> Connections::Admit() {
  const bool is_full = count() >= most_ || strangers_ >= most_strangers_;
  if (is_full && !CloseOldestStranger()) return nullptr;
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
                                   [](const Ticket* ticket) { return ticket->is_stranger_; });
  if (oldest == open_.end()) return false;
  Close(**oldest);
  return true;
}

// By a copy: closing may destroy the ticket.
void Connections::Close(Ticket& ticket) {
  ticket.Leave();
  const std::function<void()> close = std::move(ticket.close);
  if (close) close();
}

void Connections::Ticket::LoggedIn() {
  if (connections_ != nullptr && is_stranger_) --connections_->strangers_;
  is_stranger_ = false;
}

void Connections::Ticket::Leave() {
  if (connections_ == nullptr) return;
  LoggedIn();
  connections_->open_.erase(place_);
  connections_ = nullptr;
}

}  // namespace palpate::web
