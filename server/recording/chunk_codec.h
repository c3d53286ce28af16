// What a recording's chunks hold, to bytes and back.
//
// Samples are stored by fields: numbers of one field, each as its difference to
// the one before, byte by byte of equal weight, so that what changes little
// becomes long runs of zeros for the packer: 103 bytes per tick of a hand that
// explores, where plain structs pack to 132 and XOR with the one before to 111.
// Settings are lines "key=value", with the names of settings.h and numbers in the
// shortest form that reads back to the same bits, so that a new setting leaves old
// recordings readable.
//
// Threads: pure. Not for real-time code.
#pragma once

#include "server/recording/chunk_frame.h"
#include "server/recording/recording.h"

namespace palpate {

// Ticks of samples are consecutive. kInvalidArgument for more than
// kSamplesPerChunk samples, or none.
Payload EncodeChunk(const RecordedChunk& chunk);

// Throws DamagedBytes for bytes that EncodeChunk does not make.
RecordedChunk DecodeChunk(const Payload& payload);

}  // namespace palpate
