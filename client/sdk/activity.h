// Who is connected to the daemon, and who changed what. activity.proto explains the fields.
//
// Threads: plain values.
#pragma once

#include "common/contract/activity.h"

namespace palpate::client {

using palpate::ConnectedCaller;
using palpate::LastChange;

using Activity = GetActivityResponse;

}  // namespace palpate::client
