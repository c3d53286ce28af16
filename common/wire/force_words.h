// What the safety stage does with forces, in words. Pure; any thread.
#pragma once

#include <string>

#include "palpate/v1/device.pb.h"

namespace palpate {

// "off", "ramp_in", "on", "held", "fault", "stopped".
std::string NameOf(v1::ForceState state);
// "none", "operator", "docked", ...: the enum's names.
std::string NameOf(v1::ForceReason reason);

// Why forces are not fully on and what to do, in one line without an end; empty
// where they are.
std::string InWords(v1::ForceReason reason);

}  // namespace palpate
