// Connects to palpated, or explains why that fails.
//
// Threads: main only.
#pragma once

#include <memory>
#include <string>

#include "client/sdk/calls.h"

namespace palpate::cli {

// The first call connects. Warns on stderr if others may read the token file. Errors: as Calls'.
std::unique_ptr<client::Calls> Connect(const client::Server& server);

// As Connect, and connects within 3 s.
// Errors: an Error whose text says what to do: kUnavailable (nothing answers), kPermissionDenied,
// kInvalidArgument (a malformed address).
std::unique_ptr<client::Calls> Reach(const client::Server& server);

// Returns a warning if others may read the file with our token, else "".
std::string TokenFileWarning(const std::string& path);

}  // namespace palpate::cli
