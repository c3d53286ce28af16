// Command lines of `palpate edit`, `undo`, `redo`, `revert` and `save`.
//
// Threads: main only.
#pragma once

#include <CLI/CLI.hpp>

#include "client/cli/invocation.h"

namespace palpate::cli {

void AddEdit(CLI::App& app, Invocation& invocation);
// undo, redo, revert.
void AddHistory(CLI::App& app, Invocation& invocation);
void AddSave(CLI::App& app, Invocation& invocation);

}  // namespace palpate::cli
