// palpate-lab replay --recording and palpate-lab export.
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
  // Instead of the first one that the recording names and does not hold; empty: that one.
  std::string volume{};
  bool allow_missing = false;
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Computes the recording again and prints what it compared. Throws Error: kInternal
// where a tick differs; what the volume's load threw, or kConflict, where none could be
// compared; kConflict where the volume or the scene of some is missing and that is not allowed.
void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out);

struct ExportOptions {
  std::filesystem::path recording{};
  std::filesystem::path output{};  // empty: `out`
};

// Writes the recording's table of ticks.
void ExportRecording(const ExportOptions& options, std::ostream& out);

}  // namespace palpate::lab
