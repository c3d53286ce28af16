// What the command line asked for, and what the options of all commands share.
//
// Each command has a function Add...(arguments::Command&, Invocation&) that describes it
// and, when it was named, puts what to do into the invocation.
// Threads: main only.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

class Connection;

struct Invocation {
  client::ServerChoice server;
  bool json = false;
  std::function<void(const Connection&)> command;
};

// Examples, and what holds for every command.
void SetFooter(arguments::Command& command, const std::string& examples);

}  // namespace palpate::cli
