// Puts the parts together and runs them until a signal comes.
//
// Threads: main, with SIGINT, SIGTERM, SIGQUIT and SIGHUP blocked in every thread.
// Errors: Error.
#pragma once

#include "server/app/reload.h"

namespace palpate {

// Blocks the signals that the daemon waits for. Call it before any thread starts.
void BlockSignals();

// Returns after a clean end. At the end the force is zero first, then the streams stop. On SIGHUP,
// calls `read` to read the configuration again. Without `read`, SIGHUP ends the daemon as SIGTERM
// does.
void RunDaemon(const LoadedConfig& loaded, const ConfigReader& read);

}  // namespace palpate
