// `palpate doctor`: checks whether this machine is fit for the haptic loop, and says what to do.
#pragma once

#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

struct DoctorValues {
  bool requested = false;
  bool json = false;
};

// The command needs no daemon, so it is not stored in an Invocation.
void AddDoctor(arguments::Command& app, DoctorValues& values);

// Prints one finding per line, and below it what to do. Also checks the daemon if one runs. Returns
// the exit code: 0, or that of kFailedPrecondition if something does not work at all. Errors: as
// WriteOutput.
int RunDoctor(const client::Server& server, bool json);

}  // namespace palpate::cli
