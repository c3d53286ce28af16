// Writes a recording as HDF5, for MATLAB and whatever else reads plain arrays.
//
//   /ticks/NAME      an array for each field of a tick; rows are ticks
//   /ticks/unix_ns   as in csv_export.h; absent if the recording does not tell it
//   /markers/tick, /markers/time_ns, /markers/text   if there are markers
//
// Numbers are doubles and integers; words are their numbers, and the attribute `words` names them.
// The attribute `unit` is that of the name. A text has a constant length, padded by zero bytes.
// There are no compounds, enumerations or texts of variable length.
//
// Threads: one at a time. Not for real-time code. Errors: Error(kUnavailable) if the file cannot be
// written, or exists.
#pragma once

#include <filesystem>

#include "server/recording/recording_reader.h"

namespace palpate::lab {

// Reads to the end. Afterwards, ask the reader if the recording was complete.
void ExportHdf5(RecordingReader& reader, const std::filesystem::path& file);

}  // namespace palpate::lab
