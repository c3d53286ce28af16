// Puts the parts together and runs them until a signal comes.
//
// Threads: main, with SIGINT, SIGTERM and SIGHUP blocked in every thread.
// Errors: Error.
#pragma once

#include "server/app/config.h"

namespace palpate {

// Blocks the signals that end the daemon; before any thread starts.
void BlockEndingSignals();

// Returns after a clean end: zero force first, then the streams.
void RunDaemon(const Config& config);

}  // namespace palpate
