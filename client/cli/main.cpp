// palpate: the command line client of palpated. Parses and dispatches.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/output.h"
#include "client/cli/reach.h"
#include "client/program/server_options.h"
#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

// Rewrites numbers such as -.5, which the parser takes for options. The parser understands -200.
std::vector<std::string> Arguments(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  for (std::string& argument : arguments) {
    if (argument.size() > 2 && argument.compare(0, 2, "-.") == 0 && argument[2] >= '0' &&
        argument[2] <= '9') {
      argument = "-0" + argument.substr(1);
    }
  }
  return arguments;
}

void AddCompletion(arguments::Command& app, bool& requested) {
  arguments::Command* command = app.add_subcommand(
      "completion", "Prints the script by which bash and zsh complete palpate's command line");
  command->footer(
      "Example, for ~/.bashrc or ~/.zshrc: source <(palpate completion)\n"
      "The Debian package brings it for bash.");
  command->callback([&requested] { requested = true; });
}

int Fail(const std::string& message, int exit_code) {
  std::fprintf(stderr, "palpate: %s\n", OneLine(message).c_str());
  return exit_code;
}

int Main(int argc, char** argv) {
  Invocation invocation;
  DoctorValues doctor;
  arguments::Command app(
      "Steers and watches palpated, the daemon that makes a volume's isosurface felt.", "palpate");
  app.footer(
      "Exit codes: 0 done, 2 wrong usage, 3 wrong value, 4 not found, 5 no permission,\n"
      "6 too large, 7 conflict, 8 palpated unavailable, 9 cancelled, 10 something is missing,\n"
      "11 disk full, 1 anything else.\n"
      "Emergency stop: palpate device stop\n"
      "Example: palpate set isovalue 40.8");
  app.set_version_flag("--version", std::string("palpate ") + PALPATE_VERSION);
  app.require_subcommand(1);
  app.fallthrough();
  client::AddServerOptions(app, invocation.server);
  AddInfo(app, invocation);
  AddWatch(app, invocation);
  AddSet(app, invocation);
  AddSettings(app, invocation);
  AddLayers(app, invocation);
  AddLayer(app, invocation);
  AddTool(app, invocation);
  AddLoad(app, invocation);
  AddPlace(app, invocation);
  AddEdit(app, invocation);
  AddHistory(app, invocation);
  AddSave(app, invocation);
  AddDownload(app, invocation);
  AddRecord(app, invocation);
  AddMark(app, invocation);
  AddReplay(app, invocation);
  AddUpload(app, invocation);
  AddSeries(app, invocation);
  AddDevice(app, invocation);
  AddWho(app, invocation);
  AddDoctor(app, doctor);
  bool wants_completion = false;
  AddCompletion(app, wants_completion);
  try {
    if (!app.parse(Arguments(argc, argv))) return 0;
  } catch (const arguments::UsageError& error) {
    app.explain(error);
    return kUsageExitCode;
  }
  if (wants_completion) {
    WriteOutput(arguments::CompletionScript(app));
    return 0;
  }
  const client::Server server = client::Resolve(invocation.server);
  if (doctor.requested) return RunDoctor(server, doctor.json);
  invocation.command(invocation.connects_first ? *Reach(server) : *Connect(server));
  return 0;
}

// Returns the program's exit code.
int Guarded(int argc, char** argv) {
  try {
    return Main(argc, argv);
  } catch (const OutputClosed&) {
    return 0;
  } catch (const Error& error) {
    return Fail(error.what(), ExitCode(error.kind()));
  } catch (const std::exception& error) {
    return Fail(std::string("internal error: ") + error.what(), ExitCode(ErrorKind::kInternal));
  }
}

}  // namespace
}  // namespace palpate::cli

int main(int argc, char** argv) {
  // A write to a closed output must return an error, and not end the process.
  std::signal(SIGPIPE, SIG_IGN);
  palpate::client::Calls::SilenceTransport();
  const int exit_code = palpate::cli::Guarded(argc, argv);
  std::fflush(nullptr);
  // Without the clean-up of libraries: threads of gRPC outlive its channels a little, and would
  // crash in an OpenSSL that has cleaned up.
  std::_Exit(exit_code);
}
