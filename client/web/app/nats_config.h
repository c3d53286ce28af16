// The room of a NATS server that this gateway publishes, or that it serves to its guests.
//
// Threads: main only; reads files.
#pragma once

#include <functional>
#include <string>

#include "client/web/room/nats_options.h"

namespace palpate::web {

struct NatsConfig {
  std::string publish{};  // URL: what palpated does goes there
  std::string from{};     // URL: guests see what comes from there; no palpated is followed
  // The file's keys: the room, the server without its URL, and sites, which may steer from
  // elsewhere if this gateway publishes.
  RoomOptions options{};

  // Empty: no NATS server is used.
  const std::string& url() const { return publish.empty() ? from : publish; }
};

// Calls `attempt` with each check, which throws what is wrong. Plain text goes to loopback alone,
// and nobody else may read the password. Looks for the files that are named.
void CheckNats(const NatsConfig& nats,
               const std::function<void(const std::function<void()>& check)>& attempt);

}  // namespace palpate::web
