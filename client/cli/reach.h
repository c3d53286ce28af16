// The way to palpated, or why there is none.
//
// Threads: main only.
#pragma once

#include <memory>
#include <string>

#include "client/sdk/calls.h"

namespace palpate::cli {

// Connects within 3 s. Warns on stderr of a token file that others may read.
// Errors: Error saying what to do; kUnavailable when nothing answers there,
// kPermissionDenied, kInvalidArgument for an address that is none.
std::unique_ptr<client::Calls> Reach(const client::Server& server);

// What to warn of where others may read the file with our token; empty: nothing.
std::string TokenFileWarning(const std::string& path);

}  // namespace palpate::cli
