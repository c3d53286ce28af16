// `palpate doctor`: whether this machine is fit for the haptic loop, and what to do.
#pragma once

#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

struct DoctorValues {
  bool requested = false;
  bool json = false;
};

// Needs no daemon, and so is not an Invocation's command.
void AddDoctor(arguments::Command& app, DoctorValues& values);

// Prints a finding a line, with what to do below it; returns the exit code: 0, or that
// of kFailedPrecondition where something does not work at all. Looks at the daemon too
// where there is one. Errors: as WriteOutput.
int RunDoctor(const client::Server& server, bool json);

}  // namespace palpate::cli
