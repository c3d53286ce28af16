// A device that the daemon's machine has or could use, described for people.
#pragma once

#include <string>

#include "server/device/haptic_device.h"

namespace palpate {

struct ListedDevice {
  std::string kind{};     // configuration name
  std::string model{};    // for people
  std::string port{};     // for example USB port "1-2"; "": the device has no port
  bool usable = false;    // present, and this user may open it
  std::string problem{};  // what is missing and what to do; "" if usable
  VerificationLevel verification_level = VerificationLevel::kNone;
};

}  // namespace palpate
