// The options that every program has to choose a palpated and the credentials for it.
//
// Threads: main only.
#pragma once

#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::client {

// --profile, --socket, --role, --server, --tls-ca, --tls-cert, --tls-key, --token-file.
void AddServerOptions(arguments::Command& app, ServerChoice& server);

}  // namespace palpate::client
