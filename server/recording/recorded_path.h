// The path of the stylus in a recording, for the replay device.
//
// Frame: D (mm). Threads: any. Not for real-time code.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "server/device/haptic_device.h"
#include "server/recording/recording_reader.h"

namespace palpate {

// An hour: 290 MB.
inline constexpr std::size_t kLongestPathStates = 3'600'000;

// One state a millisecond, from the first good position on. Where there is none (a
// rejected position, ticks that were missed or not recorded) the last good state holds.
//
// Throws Error: kNotFound; kInvalidArgument for what is no recording, is damaged or was
// not closed, has another tick than 1 ms, or holds no position; kTooLarge above
// `longest` states.
std::vector<DeviceState> ReadStylusPath(const std::filesystem::path& file,
                                        std::size_t longest = kLongestPathStates);
// `name`: for messages.
std::vector<DeviceState> ReadStylusPath(RecordingReader& reader, const std::string& name,
                                        std::size_t longest = kLongestPathStates);

}  // namespace palpate
