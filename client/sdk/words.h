// Enumerators of the client library as words for the command line, JSON and logs. Forces as
// sentences for people. Pure; any thread.
#pragma once

#include <optional>
#include <string>

#include "client/sdk/device.h"
#include "client/sdk/recording.h"

namespace palpate::client {

// Such as "ramp_in", "stop_call", "constrained", "force_verified", "operator". "unknown" for an
// enumerator of a later daemon.
std::string NameOf(ForceState state);
std::string NameOf(ForceReason reason);
std::string NameOf(ProxyMode mode);
std::string NameOf(FreeSide side);
std::string NameOf(VerificationLevel level);
std::string NameOf(DeviceConnection connection);
std::string NameOf(Role role);

// "3 edits are not saved".
std::string UnsavedInWords(std::uint64_t edits);

// The sentence that everybody is told in a replay: "replay of trial-7.palrec by token ada: forces
// are off". None: without the file and who replays it.
std::string InWords(const std::optional<RunningReplay>& replay);

// Says why forces are not fully on and what to do, in one line without a full stop. Empty if forces
// are on.
std::string InWords(ForceReason reason);

}  // namespace palpate::client
