// How a panel shows a setting, by the client library's list.
//
// Pure; any thread.
#pragma once

#include <string>

#include "client/sdk/settings.h"

namespace palpate::view {

// Whether it has a use now: one that belongs to a tool has none while the tool is off.
bool IsShown(const client::Setting& setting, const client::Settings& settings);

// The format of a slider, for printf: "%.2f N/mm". `setting` is a number.
std::string SliderFormat(const client::Setting& setting);

}  // namespace palpate::view
