// What the command line asked for, and what the options of all commands share.
//
// Each command has a function Add...(CLI::App&, Invocation&) that describes it
// and, when it was named, puts what to do into the invocation.
// Threads: main only.
#pragma once

#include <CLI/CLI.hpp>
#include <cmath>
#include <functional>
#include <string>

#include "client/cli/connection.h"

namespace palpate::cli {

struct Invocation {
  client::Address address;
  client::Credentials credentials;
  bool json = false;
  std::function<void(const Connection&)> command;
};

// A number that is finite.
CLI::Validator Finite();
// A number above 0, up to `greatest`.
CLI::Validator Positive(double greatest = HUGE_VAL);

// Examples, and what holds for every command.
void SetFooter(CLI::App& command, const std::string& examples);

}  // namespace palpate::cli
