// The commands of palpate. Each function describes one command. If the command line names the
// command, the function's callback stores the action in the invocation.
//
// Threads: main only.
#pragma once

#include <string>

#include "client/cli/invocation.h"
#include "client/sdk/server_choice.h"
#include "common/arguments/arguments.h"

namespace palpate::cli {

void AddInfo(arguments::Command& app, Invocation& invocation);
void AddWatch(arguments::Command& app, Invocation& invocation);
void AddSet(arguments::Command& app, Invocation& invocation);
void AddSettings(arguments::Command& app, Invocation& invocation);
void AddLayers(arguments::Command& app, Invocation& invocation);
void AddLayer(arguments::Command& app, Invocation& invocation);
void AddTool(arguments::Command& app, Invocation& invocation);
void AddLoad(arguments::Command& app, Invocation& invocation);
void AddUpload(arguments::Command& app, Invocation& invocation);
void AddDownload(arguments::Command& app, Invocation& invocation);
void AddSave(arguments::Command& app, Invocation& invocation);
void AddPlace(arguments::Command& app, Invocation& invocation);
void AddEdit(arguments::Command& app, Invocation& invocation);
void AddHistory(arguments::Command& app, Invocation& invocation);  // undo, redo, revert
void AddSeries(arguments::Command& app, Invocation& invocation);
void AddRecord(arguments::Command& app, Invocation& invocation);
void AddMark(arguments::Command& app, Invocation& invocation);
void AddReplay(arguments::Command& app, Invocation& invocation);
void AddWho(arguments::Command& app, Invocation& invocation);
void AddDevice(arguments::Command& app, Invocation& invocation);

// `palpate doctor`: checks whether this machine is fit for the haptic loop, and says what to do.
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

// `palpate device prove`: the terminal, the daemon and the folder of a proof.
void AddProve(arguments::Command& device, Invocation& invocation);

// Of the tool's command: what is felt of the settings' ball or tool, with the commands that make it
// fit; empty: that itself.
std::string TipInWords(client::Calls& palpated, const client::Settings& settings);

}  // namespace palpate::cli
