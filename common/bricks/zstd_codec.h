// Voxels for transfer: zstd of values as they lie in memory, little-endian.
//
// Threads: any; each thread has its own zstd state. Not for real-time code.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace palpate {

// Uses level 1: on a local socket, a viewer waits for the processor and not for the network.
std::string CompressBytes(std::span<const std::byte> values);

template <class T>
std::string Compress(std::span<const T> values) {
  return CompressBytes(std::as_bytes(values));
}

// The longest that so many bytes become. A longer frame holds what no voxels need.
std::size_t MostCompressedBytes(std::size_t bytes);

// Returns the number of values that `zstd` claims to hold. Errors: kInvalidArgument if `zstd`
// states no size, or more than `most` values.
std::size_t CountValues(std::string_view zstd, std::size_t value_bytes, std::size_t most);

// Fills `values`. Errors: kInvalidArgument if `zstd` does not hold exactly as many bytes.
void DecompressBytes(std::string_view zstd, std::span<std::byte> values);

template <class T>
void Decompress(std::string_view zstd, std::span<T> values) {
  DecompressBytes(zstd, std::as_writable_bytes(values));
}

}  // namespace palpate
