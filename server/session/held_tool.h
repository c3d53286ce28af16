// Checks the tool of the settings.
//
// Threads: pure functions.
#pragma once

#include <string>

#include "common/contract/device.h"
#include "common/contract/render.h"
#include "server/haptics/settings.h"

namespace palpate {

// Throws Error (kInvalidArgument) for what no tool can be: too many balls or radii, numbers out of
// range.
void CheckTool(const HeldTool& tool);

// Which other settings forbid a tool, for people; empty: none, or there is no tool.
std::string RefusalWithTool(const HapticSettings& haptics);

// Throws Error (kFailedPrecondition) if there is a tool, and other settings or the device forbid
// it.
void CheckHeld(const HapticSettings& haptics, const DeviceDescription& device);

}  // namespace palpate
