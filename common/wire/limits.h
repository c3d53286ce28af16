// Lengths that the contract bounds, for those who send and those who refuse.
#pragma once

#include <cstddef>

namespace palpate {

// Of the values of one block of an edit (edit.proto), in bytes: with all else of its
// message below the 4 MiB that a message may have.
inline constexpr std::size_t kMostBlockBytes = std::size_t{3} << 20;

}  // namespace palpate
