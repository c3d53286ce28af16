// The emergency stop by palpated's own socket for it (server/stop/stop_door.h).
//
// Threads: any. Errors: see below.
#pragma once

#include <optional>
#include <string>

#include "client/sdk/device.h"

namespace palpate::client {

// `path`: of the stop's socket. Returns what the forces are then; none if nobody answers there, as
// with a palpated of the last release: then the stop must go by gRPC. Takes up to some seconds.
// Errors: kUnavailable: the loop does not tick, and the stop acts in its next tick.
std::optional<ForceResult> StopBySocket(const std::string& path);

}  // namespace palpate::client
