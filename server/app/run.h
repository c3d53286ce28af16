// What palpated's main() runs: the daemon, or the commands for tokens.
//
// Threads: main. Errors: Error.
#pragma once

#include <functional>

#include "common/arguments/arguments.h"
#include "server/app/reload.h"

namespace palpate {

// Blocks the signals that the daemon waits for. Call it before any thread starts.
void BlockSignals();

// Puts the parts together and runs them until a signal comes, with SIGINT, SIGTERM, SIGQUIT and
// SIGHUP blocked in every thread. Returns after a clean end. At the end the force is zero first,
// then the streams stop. On SIGHUP, calls `read` to read the configuration again. Without `read`,
// SIGHUP ends the daemon as SIGTERM does.
void RunDaemon(const LoadedConfig& loaded, const ConfigReader& read);

// The commands `palpated token` add, list and revoke, which edit the file of clients' tokens.
// Before any other thread starts. Sets `run` if one of the commands is given.
void AddTokenCommands(arguments::Command& app, std::function<void()>& run);

}  // namespace palpate
