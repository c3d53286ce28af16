// The gateway, assembled: palpated on one side, guests on the other.
//
// Threads: main, which becomes the network thread. Errors: Error at the start.
#pragma once

#include "client/web/app/config.h"

namespace palpate::web {

// Serves until SIGINT or SIGTERM, and ends the program. Prints the link for guests when they are
// served; without the key if that is in a file and the standard output is no terminal.
[[noreturn]] void Serve(const Config& config);

}  // namespace palpate::web
