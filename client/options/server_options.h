// The options by which every program says which palpated it talks to, and who it is there.
//
// Threads: main only.
#pragma once

#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::client {

// --profile, --socket, --server, --tls-ca, --tls-cert, --tls-key, --token-file.
void AddServerOptions(arguments::Command& app, ServerChoice& server);

}  // namespace palpate::client
