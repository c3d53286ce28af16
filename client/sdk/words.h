// Sentences for people; those of enumerators are in common/contract/enumerations.h. Pure; any
// thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "client/sdk/recording.h"
#include "client/sdk/settings.h"
#include "common/contract/enumerations.h"

namespace palpate::client {

using palpate::InWords;
using palpate::NameOf;

// "3 edits are not saved".
std::string UnsavedInWords(std::uint64_t edits);

// The sentence that everybody is told in a replay: "replay of trial-7.mcap by token ada: forces
// are off". None: without the file and who replays it.
std::string InWords(const std::optional<RunningReplay>& replay);

// What is felt of the settings' ball or tool; empty: that itself.
std::string BallInWords(const Settings& settings);

}  // namespace palpate::client
