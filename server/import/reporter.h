// Writes palpate-import's output: warnings and the one error line to stderr, progress to stdout.
// Keeps the libraries' own output (GDCM prints) off both.
//
// Threads: one. Not for real-time code.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "common/error/error.h"

namespace palpate {

class Reporter {
 public:
  // Redirects file descriptors 1 and 2 to /dev/null (in sanitizer builds only 1). Only this object
  // writes to the former ones. `input`: the file's name in messages.
  Reporter(std::string input, bool show_progress);

  // Writes "progress FRACTION STAGE", with the fraction of the whole import.
  void Progress(double fraction, std::string_view stage);
  // Writes "size X Y Z BYTES": the number of voxels that will be read, and the bytes of each. The
  // last line counts.
  void Size(const std::array<std::int64_t, 3>& size, int bytes_per_voxel);
  // Writes "palpate-import: warning: FILE: MESSAGE".
  void Warn(std::string_view message);
  // Writes "palpate-import: FILE: MESSAGE".
  void Fail(std::string_view message);
  // After `seconds` of wall clock, or at the limit of processor time, writes a failure and exits
  // with the code of kTooLarge.
  void FailAfter(unsigned seconds);
  // From now on a crash writes this failure, and exits with the code of `kind`. Libraries crash on
  // valid files, too.
  void FailOnCrash(const std::string& message, ErrorKind kind);

 private:
  std::string input_;
  int progress_fd_ = -1;
  int message_fd_ = -1;
};

}  // namespace palpate
