// The script by which shells complete a program's command line.
//
// Threads: main only.
#pragma once

#include <string>

#include "common/arguments/arguments.h"

namespace palpate::arguments {

// For bash, and for zsh with its bashcompinit. Completes commands, options, and the words of a
// value. Completes file names elsewhere.
std::string CompletionScript(const Command& program);

}  // namespace palpate::arguments
