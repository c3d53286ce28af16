// Floats as they travel: zstd of little-endian float32.
//
// Threads: any; each keeps its own zstd state. Not real-time.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace palpate {

// At level 1: on a local socket the processor is what a viewer waits for.
std::string CompressFloats(std::span<const float> values);

// Floats in `bytes`, by what they say of themselves. Errors: kInvalidArgument where
// they do not, and for more than `most`.
std::size_t CountFloats(std::string_view bytes, std::size_t most);

// Fills `values` exactly. Errors: kInvalidArgument for anything but the zstd of as
// many floats.
void DecompressFloats(std::string_view bytes, std::span<float> values);

}  // namespace palpate
