// Settings as lines "key=value", by the names of settings.h.
//
// Threads: pure. Not for real-time code.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/haptics/settings.h"

namespace palpate {

// Numbers in the shortest form that reads back to the same bits.
std::string SettingsText(const HapticSettings& settings);

// Settings that the text does not name keep their defaults, which is how a
// program felt that did not know them. Names that are no settings here are
// appended to `unknown`. Throws DamagedBytes for what is no such line.
HapticSettings SettingsFromText(std::string_view text, std::vector<std::string>& unknown);

}  // namespace palpate
