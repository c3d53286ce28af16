// The display of a setting in a panel, from the client library's list.
//
// Pure; any thread.
#pragma once

#include <string>

#include "client/sdk/settings.h"

namespace palpate::view {

// False while the setting has no effect: it belongs to a tool that is off.
bool IsShown(const client::Setting& setting, const client::Settings& settings);

// The slider's printf format: "%.2f N/mm". `setting` must be a number.
std::string SliderFormat(const client::Setting& setting);

}  // namespace palpate::view
