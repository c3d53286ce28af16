// Converts a recording's chunks to bytes and back.
//
// Samples are stored field by field. Each number is stored as its difference from the one before,
// and bytes of equal weight are stored together. Fields that change little become long runs of
// zeros, which pack well. While a hand explores, a tick takes 103 bytes. Plain structs take 132
// bytes packed, and XOR with the number before takes 111.
// Settings are lines "key=value", with the names of settings.h. Numbers have the shortest form that
// reads back to the same bits. A new setting leaves old recordings readable.
//
// Threads: pure. Not for real-time code.
#pragma once

#include "server/recording/chunk_frame.h"
#include "server/recording/recording.h"

namespace palpate {

// The ticks of samples must be consecutive. Throws kInvalidArgument for no sample or more than
// kSamplesPerChunk samples.
Payload EncodeChunk(const RecordedChunk& chunk);

// Throws DamagedBytes for bytes that EncodeChunk cannot produce.
RecordedChunk DecodeChunk(const Payload& payload);

}  // namespace palpate
