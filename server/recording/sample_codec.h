// Encodes the columns of a chunk of samples; see chunk_codec.h.
//
// Threads: pure. Not for real-time code.
#pragma once

#include <string>
#include <string_view>

#include "server/recording/recording.h"

namespace palpate {

std::string EncodeSamples(const RecordedSamples& samples);
// Throws DamagedBytes.
RecordedSamples DecodeSamples(std::string_view bytes);

}  // namespace palpate
