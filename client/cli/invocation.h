// What the command line asked for, and what the options of all commands share.
//
// Each command has a function Add...(arguments::Command&, Invocation&) that describes it
// and, when it was named, puts what to do into the invocation.
// Threads: main only. What a command does may throw Error, as client::Calls does, and what
// WriteOutput throws.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/calls.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

struct Invocation {
  client::ServerChoice server;
  bool json = false;
  std::function<void(client::Calls&)> command;
};

// Examples, and what holds for every command.
void SetFooter(arguments::Command& command, const std::string& examples);

// --json, into invocation.json.
void AddJson(arguments::Command& command, Invocation& invocation);

// Three numbers, X,Y,Z.
arguments::Option* AddTriple(arguments::Command& command, const std::string& name,
                             std::vector<double>& values, const std::string& about);
inline Vec3 VectorOf(const std::vector<double>& values) {
  return {values[0], values[1], values[2]};
}

}  // namespace palpate::cli
