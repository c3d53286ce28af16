// The serial number of a Phantom Omni, as the vendor's tools print it, in the lower word of its
// GUID.
//
// From the highest bit: 6 bits that are 100000, year (3), month (4), day (5), a kind (3), number
// (10), one bit without a meaning. Printed: year, month, day and kind as 1, 2, 2 and 1 digits, then
// the number with 5.
// Source: two public drivers and a public test program, and the GUIDs and serial numbers of two
// devices, which agree.
// Threads: pure functions.
#pragma once

#include <cstdint>
#include <string>

namespace palpate {

inline constexpr std::uint32_t kOmniVendor = 0x000b99;  // the upper 24 bits of its GUID

std::string OmniSerialOf(std::uint64_t guid);

}  // namespace palpate
