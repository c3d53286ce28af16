// The script by which shells complete a program's command line.
//
// Threads: main only.
#pragma once

#include <string>

#include "common/arguments/arguments.h"

namespace palpate::arguments {

// For bash, and for zsh by its bashcompinit: commands, options, and the words that a value may be;
// else names of files.
std::string CompletionScript(const Command& program);

}  // namespace palpate::arguments
