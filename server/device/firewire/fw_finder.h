// Looks for nodes of the machine's FireWire buses. Opens none.
//
// Threads: any. Not real-time. Errors: none; what cannot be read is not there.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

struct FwFound {
  std::uint64_t guid = 0;
  std::string node{};     // "/dev/fw1"
  bool may_open = false;  // this user may open it
};

// The nodes of other machines and devices whose GUID begins with `vendor` (24 bits), by GUID.
std::vector<FwFound> FindFwNodes(std::uint32_t vendor);

// Whether this machine has a FireWire controller with a driver.
bool HasFwController();

}  // namespace palpate
