// What all connections of a server share.
//
// Threads: the network thread.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "client/web/http/answer.h"
#include "client/web/http/connections.h"
#include "client/web/http/http_options.h"
#include "client/web/http/origins.h"
#include "client/web/http/quiet_log.h"
#include "client/web/http/static_files.h"
#include "client/web/hub/hub.h"
#include "client/web/logins/access.h"

namespace palpate::web {

class Guest;

struct Site {
  Site(Hub& the_hub, HttpOptions the_options, AccessOptions access_options, HttpEvents the_events,
       std::uint16_t port)
      : hub(the_hub),
        options(std::move(the_options)),
        events(std::move(the_events)),
        access(std::move(access_options)),
        origins(options, port),
        files(options.page_folder),
        connections(options.max_connections, options.max_strangers) {}

  Hub& hub;
  const HttpOptions options;
  const HttpEvents events;
  Access access;
  const Origins origins;
  const StaticFiles files;
  Connections connections;
  QuietLog log{events};
  HeldBodies bodies{options.max_held_bytes};
  std::vector<Guest*> guests;  // oldest first
  // As of the last sweep: for what need not be exact.
  Time now = std::chrono::steady_clock::now();
};

}  // namespace palpate::web
