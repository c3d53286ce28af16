// palpate-lab replay --recording, and export.
//
// Threads: the calling one. Errors: Error.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>

#include "server/lab/load_volume.h"

namespace palpate::lab {

struct RecordingReplayOptions {
  std::filesystem::path recording{};
  // Loaded instead of the first volume that the recording names but does not hold. Empty: the
  // volume that the recording names is loaded.
  std::string volume{};
  bool allow_missing = false;
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Computes the recording again and prints the results of the comparison. Throws Error:
//   kInternal             a tick differs
//   the load's own error  no tick could be compared because the volume could not be loaded
//   kConflict             no tick could be compared for another reason, or the volume or the scene
//                         of some ticks is missing and options.allow_missing is false
void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out);

struct ExportOptions {
  std::filesystem::path recording{};
  std::filesystem::path output{};  // empty: writes to `out`
  bool overwrite = false;          // of `output`
  bool hdf5 = false;               // refused: the error names what writes it
};

// Writes the recording's table of ticks as CSV.
void ExportRecording(const ExportOptions& options, std::ostream& out);

}  // namespace palpate::lab
