// Lengths that the contract bounds, for those who send and those who refuse.
#pragma once

#include <cstddef>

namespace palpate {

// Of the values of one block of an edit (edit.proto), in bytes. It decides how long a message may
// be: 64 KiB more, for all else of it.
inline constexpr std::size_t kMostBlockBytes = std::size_t{3} << 20;

}  // namespace palpate
