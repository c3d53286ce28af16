// Whether the gateway has more rights at palpated than it needs: whoever takes it over has them.
//
// Threads: pure. Apart for its tests.
#pragma once

#include <string>

#include "client/sdk/device.h"

namespace palpate::web {

// A line for the log; empty: no more rights than needed. `steers`: some user may change settings.
std::string RightsWarning(client::Role role, bool steers);

}  // namespace palpate::web
