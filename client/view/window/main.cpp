// palpate-view: shows in a window or a file what palpated makes users feel.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>

#include "client/program/interrupt.h"
#include "client/sdk/calls.h"
#include "client/view/viewer/options.h"
#include "client/view/window/run.h"
#include "common/arguments/arguments.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

int Fail(const std::string& message, int exit_code) {
  std::fprintf(stderr, "palpate-view: %s\n", message.c_str());
  return exit_code;
}

// Returns the program's exit code.
int Guarded(int argc, char** argv) {
  try {
    const std::optional<Options> options = ParseOptions(argc, argv);
    if (!options) return 0;
    const Interrupt interrupt;
    if (options->offscreen) {
      RunOffscreen(*options);
    } else {
      RunWindow(*options);
    }
    return 0;
  } catch (const arguments::UsageError& error) {
    return Fail(error.what(), kUsageExitCode);
  } catch (const Error& error) {
    return Fail(error.what(), ExitCode(error.kind()));
  } catch (const std::exception& error) {
    return Fail(std::string("internal error: ") + error.what(), ExitCode(ErrorKind::kInternal));
  }
}

}  // namespace
}  // namespace palpate::view

int main(int argc, char** argv) {
  // A write to a closed output must return an error, and not end the process.
  std::signal(SIGPIPE, SIG_IGN);
  palpate::client::Calls::SilenceTransport();
  const int exit_code = palpate::view::Guarded(argc, argv);
  std::fflush(nullptr);
  // Without the clean-up of libraries: see client/cli/main.cpp.
  std::_Exit(exit_code);
}
