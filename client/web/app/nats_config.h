// The room of a NATS server that this gateway publishes, or that it serves to its guests.
//
// Threads: main only; reads files.
#pragma once

#include <string>
#include <vector>

#include "client/web/nats/nats_options.h"

namespace palpate::web {

struct NatsConfig {
  std::string publish{};  // URL: what palpated does goes there
  std::string from{};     // URL: guests see what comes from there; no palpated is followed
  std::string room{};
  NatsServer server{};              // without its URL
  std::vector<RemoteSite> sites{};  // may steer from elsewhere, if this gateway publishes

  bool is_used() const { return !publish.empty() || !from.empty(); }
};

// What is wrong, one line each; empty: nothing. Plain text goes to loopback alone, and nobody else
// may read the password. Looks for the files that are named.
std::vector<std::string> CheckNats(const NatsConfig& nats);

// For the room's publisher or source. `log` and `steered` are not set.
RoomOptions RoomOptionsOf(const NatsConfig& nats);

}  // namespace palpate::web
