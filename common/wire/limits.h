// Length limits of the contract, for senders and receivers.
#pragma once

#include <cstddef>

namespace palpate {

// The most bytes of one block's values in an edit (edit.proto). The longest message has 64 KiB
// more, for everything else in it.
inline constexpr std::size_t kMostBlockBytes = std::size_t{3} << 20;

}  // namespace palpate
