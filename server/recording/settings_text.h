// Converts settings to lines "key=value", with the names of settings.h, and back.
//
// Threads: pure. Not for real-time code.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/haptics/settings.h"

namespace palpate {

// Numbers have the shortest form that reads back to the same bits.
std::string SettingsText(const HapticSettings& settings);

// Settings missing in the text keep their defaults: a program that did not know a setting behaved
// so. Appends names that are not settings here to `unknown`. Throws DamagedBytes for any other
// line.
HapticSettings SettingsFromText(std::string_view text, std::vector<std::string>& unknown);

}  // namespace palpate
