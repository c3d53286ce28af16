// Settings of the renderer as a command line gives them: key=value.
//
// Threads: pure functions. Errors: Error.
#pragma once

#include <string>

#include "server/haptics/settings.h"

namespace palpate::lab {

// Keys are those of server/haptics/settings.h, and free_side. kInvalidArgument for
// others and for values out of range.
void ApplySetting(const std::string& argument, HapticSettings& settings);

}  // namespace palpate::lab
