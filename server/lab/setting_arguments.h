// Settings of the renderer given on a command line: key=value.
//
// Threads: pure functions. Errors: Error.
#pragma once

#include <string>

#include "server/haptics/settings.h"

namespace palpate::lab {

// The keys are the keys of server/haptics/settings.h, and free_side. Throws kInvalidArgument for
// other keys and for values out of range.
void ApplySetting(const std::string& argument, HapticSettings& settings);

}  // namespace palpate::lab
