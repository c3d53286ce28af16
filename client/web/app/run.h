// What palpate-web's main() runs: the gateway, or its command `nats-user`.
#pragma once

#include <string>

#include "client/web/app/config.h"
#include "common/arguments/arguments.h"

namespace palpate::web {

// The gateway, assembled: palpated on one side, guests on the other.
//
// Threads: main, which becomes the network thread. Errors: Error at the start.
//
// Serves until SIGINT or SIGTERM, and ends the program. Prints the link for guests when they are
// served; without the key if that is in a file and the standard output is no terminal.
[[noreturn]] void Serve(const Config& config);

// `palpate-web nats-user`: a user of a room, for the accounts of nats-server's configuration.
//
// Threads: main only.
struct NatsUserLine {
  bool is_wanted = false;
  std::string name, room;
  bool publishes = false;
};

// Adds the subcommand; `line` must live until the command line is parsed.
void AddNatsUser(arguments::Command& app, NatsUserLine& line);

// A new random password, to be shown once, and an account with the one user, in which only a hash
// of the password is.
//
// The permissions alone would not do: nats-server does not look at the subject that a request names
// for its answer. In one account with the room's stream, a receiver who may only ask for kept
// messages could have the answer purge the room, or have it kept in another room. In an account of
// its own, the receiver gets what it imports, and no answer leaves it.
//
// Errors: kInvalidArgument.
std::string NatsUserText(const NatsUserLine& line);

}  // namespace palpate::web
