// palpated token add, list, revoke: the file of clients' tokens.
//
// Threads: main, before any other. Errors: Error.
#pragma once

#include <CLI/CLI.hpp>

#include <functional>

namespace palpate {

// `run` gets what to do where one of them was named.
void AddTokenCommands(CLI::App& app, std::function<void()>& run);

}  // namespace palpate
