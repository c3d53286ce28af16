// `palpate device prove`: the terminal, the daemon and the folder of a proof.
//
// Threads: main only.
#pragma once

#include "client/cli/invocation.h"

namespace palpate::cli {

void AddProve(arguments::Command& device, Invocation& invocation);

}  // namespace palpate::cli
