// Writes a recording as a table.
//
// Threads: any. Not for real-time code.
#pragma once

#include <ostream>
#include <span>

#include "server/recording/recording_reader.h"

namespace palpate {

// Writes one row per tick, with units in the names of the columns. Numbers have the shortest form
// that reads back to the same bits. unix_ns is the tick's UTC in ns since 1970; empty if the
// recording does not tell it. The last column has the texts of the markers set during the tick,
// separated by "; ". Ticks in gaps have no row: lost_ticks counts those before each row.
// Reads to the end. Afterwards, ask the reader if the recording was complete.
//
// Throws Error(kUnavailable) if the stream cannot be written.
void ExportCsv(RecordingReader& reader, std::ostream& stream);
// Writes the same table for ticks in memory, without their UTC.
void ExportCsv(std::span<const TickSample> ticks, std::ostream& stream);

}  // namespace palpate
