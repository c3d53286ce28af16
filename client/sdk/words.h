// Enumerators of the client library as the words that the command line, JSON and logs use, and
// forces in words for people. Pure; any thread.
#pragma once

#include <string>

#include "client/sdk/device.h"

namespace palpate::client {

// Such as "ramp_in", "stop_call", "constrained", "force_verified", "operator"; "unknown" for what
// a later daemon says.
std::string NameOf(ForceState state);
std::string NameOf(ForceReason reason);
std::string NameOf(ProxyMode mode);
std::string NameOf(FreeSide side);
std::string NameOf(VerificationLevel level);
std::string NameOf(DeviceConnection connection);
std::string NameOf(Role role);

// Why forces are not fully on and what to do, in one line without an end; empty where they are.
std::string InWords(ForceReason reason);

}  // namespace palpate::client
