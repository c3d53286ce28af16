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
  std::string volume{};  // instead of the first one that was recorded; empty: that one
  std::filesystem::path import_program = ImportProgramBesideThis();
};

// Computes the recording again and prints what it compared. Throws Error: kInternal
// where a tick differs; what the volume's load threw, or kConflict, where none could be
// compared.
void ReplayRecording(const RecordingReplayOptions& options, std::ostream& out);

struct ExportOptions {
  std::filesystem::path recording{};
  std::filesystem::path output{};  // empty: `out`
};

// Writes the recording's table of ticks.
void ExportRecording(const ExportOptions& options, std::ostream& out);

}  // namespace palpate::lab
