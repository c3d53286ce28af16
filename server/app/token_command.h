// palpated token add, list, revoke: the file of clients' tokens.
//
// Threads: main, before any other. Errors: Error.
#pragma once

#include <functional>

#include "common/arguments/arguments.h"

namespace palpate {

// `run` gets what to do where one of them was named.
void AddTokenCommands(arguments::Command& app, std::function<void()>& run);

}  // namespace palpate
