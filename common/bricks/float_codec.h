// Floats for transfer: zstd of little-endian float32.
//
// Threads: any; each thread has its own zstd state. Not for real-time code.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace palpate {

// Uses level 1: on a local socket, a viewer waits for the processor and not for the network.
std::string CompressFloats(std::span<const float> values);

// Returns the number of floats that `bytes` claims to hold. Errors: kInvalidArgument if `bytes`
// states no size, or more than `most` floats.
std::size_t CountFloats(std::string_view bytes, std::size_t most);

// Fills `values`. Errors: kInvalidArgument if `bytes` is not the zstd of exactly as many floats.
void DecompressFloats(std::string_view bytes, std::span<float> values);

}  // namespace palpate
