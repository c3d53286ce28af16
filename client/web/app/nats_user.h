// `palpate-web nats-user`: a user of a room for nats-server's configuration.
//
// Threads: main only.
#pragma once

#include <string>

#include "common/arguments/arguments.h"

namespace palpate::web {

struct NatsUserLine {
  bool is_wanted = false;
  std::string name, room;
  bool publishes = false;
};

// Adds the subcommand; `line` must live until the command line is parsed.
void AddNatsUser(arguments::Command& app, NatsUserLine& line);

// A new random password, to be shown once, and the user's block, in which only a hash of it is.
// The block gives the user no subject that the room's publisher or receiver does not need.
// Errors: kInvalidArgument.
std::string NatsUserText(const NatsUserLine& line);

}  // namespace palpate::web
