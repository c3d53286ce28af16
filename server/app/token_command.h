// The commands `palpated token` add, list and revoke, which edit the file of clients' tokens.
//
// Threads: main, before any other. Errors: Error.
#pragma once

#include <functional>

#include "common/arguments/arguments.h"

namespace palpate {

// Sets `run` if one of the commands is given.
void AddTokenCommands(arguments::Command& app, std::function<void()>& run);

}  // namespace palpate
