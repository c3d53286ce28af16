// `palpate upload` on the command line.
//
// Threads: main only.
#pragma once

#include "client/cli/invocation.h"
#include "client/cli/load_options.h"

namespace palpate::cli {

// `values` must live as long as the invocation.
void AddUpload(arguments::Command& app, Invocation& invocation, LoadValues& values);

}  // namespace palpate::cli
