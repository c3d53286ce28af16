// Puts the parts together and runs them until a signal comes.
//
// Threads: main, with SIGINT, SIGTERM, SIGQUIT and SIGHUP blocked in every thread.
// Errors: Error.
#pragma once

#include "server/app/reload.h"

namespace palpate {

// Blocks the signals that the daemon waits for; before any thread starts.
void BlockSignals();

// Returns after a clean end: zero force first, then the streams. SIGHUP has the
// configuration read again by `read`; without it, SIGHUP ends as SIGTERM does.
void RunDaemon(const LoadedConfig& loaded, const ConfigReader& read);

}  // namespace palpate
