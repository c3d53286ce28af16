// What palpate-import says: warnings and the one error line on stderr, progress
// on stdout. Keeps the libraries' own chatter (nifti_clib, MetaIO and GDCM print
// from within) off both.
//
// One thread. Not for real-time code.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace palpate {

class Reporter {
 public:
  // From here on file descriptors 1 and 2 lead nowhere and only this object
  // writes to the former ones. `input`: the file, as messages name it.
  Reporter(std::string input, bool show_progress);

  // "progress FRACTION STAGE"; fraction of the whole import.
  void Progress(double fraction, std::string_view stage);
  // "size X Y Z BYTES": so many voxels will be read, of so many bytes; the last one counts.
  void Size(const std::array<std::int64_t, 3>& size, int bytes_per_voxel);
  // "palpate-import: warning: FILE: MESSAGE".
  void Warn(std::string_view message);
  // "palpate-import: FILE: MESSAGE".
  void Fail(std::string_view message);
  // After `seconds` of wall clock, or when the limit of processor time is hit:
  // Fail() and exit with that of kTooLarge.
  void FailAfter(unsigned seconds);
  // From here on a crash is a Fail() and exit with that of kInternal: GDCM ends in
  // an assertion on some damaged files.
  void FailOnCrash();

 private:
  std::string input_;
  int progress_fd_ = -1;
  int message_fd_ = -1;
};

}  // namespace palpate
