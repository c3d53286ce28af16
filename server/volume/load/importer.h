// Runs palpate-import and listens to it. What harms that process does not harm the daemon.
//
// Any ordinary thread (blocks until the process has ended); never the servo's. Uses posix_spawn,
// because fork would make the servo's pages copy-on-write. Errors: Error.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

// The number by which the process knows the file that it gets.
inline constexpr int kChildDescriptor = 3;

struct ChildRun {
  std::vector<std::string> arguments;  // the program first
  int descriptor = -1;                 // of the file that the process gets
  // The next bytes of its standard input, valid until the next call; none at their end. Empty
  // function: no input.
  std::function<std::string_view()> input{};
  std::function<void(std::string_view line)> on_line{};  // of its standard output
  // Called at least several times a second; an exception ends the process.
  std::function<void()> check{};
};

struct ChildEnd {
  int status = 0;                     // as of waitpid
  std::vector<std::string> messages;  // its lines, without the program's name
  std::vector<std::string> warnings;
};

// No process remains, also after an exception.
ChildEnd RunChild(const ChildRun& run);

// Throws unless the process ended well: its own last line, with the kind that its exit code says.
// `what`: begins other errors. `crash`: what a crash means.
void ThrowUnlessSuccess(const ChildEnd& end, const std::string& what, const std::string& shortage,
                        const std::string& crash);

// Parses "progress FRACTION STAGE". False: another line, or a wrong one.
bool ParseProgress(std::string_view line, double& fraction, std::string_view& stage);

}  // namespace palpate
