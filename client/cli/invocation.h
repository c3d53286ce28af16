// The action that the command line asked for, and the options that all commands share.
//
// Each command has a function Add...(arguments::Command&, Invocation&). The function describes the
// command. If the command line names the command, the function's callback stores the action in the
// invocation.
// Threads: main only. An action may throw Error, as client::Calls does, and the exceptions of
// WriteOutput.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/calls.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

struct Invocation {
  client::ServerChoice server;
  bool json = false;
  bool connects_first = true;
  std::function<void(client::Calls&)> command;
};

// Sets the footer: the examples, then the text that is the same for every command.
void SetFooter(arguments::Command& command, const std::string& examples);

// Adds --json, stored in invocation.json.
void AddJson(arguments::Command& command, Invocation& invocation);

// Adds an option with three numbers, X,Y,Z.
arguments::Option* AddTriple(arguments::Command& command, const std::string& name,
                             std::vector<double>& values, const std::string& about);
inline Vec3 VectorOf(const std::vector<double>& values) {
  return {values[0], values[1], values[2]};
}

}  // namespace palpate::cli
