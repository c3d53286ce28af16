// A recording as a table.
//
// Threads: any. Not for real-time code.
#pragma once

#include <ostream>
#include <span>

#include "server/recording/recording_reader.h"

namespace palpate {

// One row per tick, with units in the names of the columns; numbers in the
// shortest form that reads back to the same bits. The last column has the texts
// of the markers set just before the tick, parted by "; ". Ticks in gaps have no
// row. Reads to the end: ask the reader then whether the recording was complete.
//
// Throws Error(kUnavailable) where the stream takes no more.
void ExportCsv(RecordingReader& reader, std::ostream& stream);
// The same of ticks that were not recorded.
void ExportCsv(std::span<const TickSample> ticks, std::ostream& stream);

}  // namespace palpate
