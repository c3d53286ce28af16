// Command lines of `palpate edit`, `undo`, `redo`, `revert` and `save`.
//
// Threads: main only.
#pragma once

#include "client/cli/invocation.h"

namespace palpate::cli {

void AddEdit(arguments::Command& app, Invocation& invocation);
// undo, redo, revert.
void AddHistory(arguments::Command& app, Invocation& invocation);
void AddSave(arguments::Command& app, Invocation& invocation);

}  // namespace palpate::cli
