// What went wrong with a device on a bus.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

namespace palpate {

enum class BusFault : std::uint8_t {
  kAbsent,      // not found, or unplugged
  kPermission,  // found, but this user may not open it
  kBusy,        // another program has claimed it
  kAmbiguous,   // several match and the configuration names none
  kUnsuitable,  // another device, or one that cannot be driven
  kStall,       // an endpoint refused
  kTimeout,     // no answer in time
  kCorrupt,     // an invalid answer
  kBroken,      // any other failure of the bus
};

// What to do after kPermission.
inline constexpr std::string_view kPermissionHint =
    "this user may not open the device: install deploy/udev/70-palpate.rules, then unplug it and "
    "plug it in again";

// what() is one line: what is wrong, and what to do.
class BusError : public std::runtime_error {
 public:
  BusError(BusFault fault, const std::string& message)
      : std::runtime_error(message), fault_(fault) {}
  BusFault fault() const { return fault_; }

 private:
  BusFault fault_;
};

}  // namespace palpate
