// A device that the daemon's machine has, or could use, for people.
#pragma once

#include <string>

#include "server/device/haptic_device.h"

namespace palpate {

struct ListedDevice {
  std::string kind{};     // configuration name
  std::string model{};    // for people
  std::string port{};     // where it was found, such as USB port "1-2"; "": needs no finding
  bool usable = false;    // it is there and may be opened
  std::string problem{};  // what is missing and what to do; "" when usable
  VerificationLevel verification_level = VerificationLevel::kNone;
};

}  // namespace palpate
