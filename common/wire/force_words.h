// The state of forces in words. Pure; any thread.
#pragma once

#include <string>

#include "palpate/v1/device.pb.h"

namespace palpate {

// "off", "ramp_in", "on", "held", "fault", "stopped".
std::string NameOf(v1::ForceState state);
// "none", "operator", "docked", ...: the names of the enum.
std::string NameOf(v1::ForceReason reason);

// Says why forces are not fully on and what to do, in one line without a full stop. Empty if forces
// are on.
std::string InWords(v1::ForceReason reason);

}  // namespace palpate
