// Reads the path of the stylus from a recording, for the replay device.
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

// One hour, which takes 350 MB.
inline constexpr std::size_t kLongestPathStates = 3'600'000;

// Returns one state per millisecond, from the first good position on. If a tick has no good
// position (the position was rejected, or the tick was missed or not recorded), the last good state
// is repeated.
//
// Throws Error:
//   kNotFound         no such file
//   kInvalidArgument  the file is not a recording, is damaged or was not closed, has another tick
//                     than 1 ms, or holds no position
//   kTooLarge         more than `longest` states
std::vector<DeviceState> ReadStylusPath(const std::filesystem::path& file,
                                        std::size_t longest = kLongestPathStates);
// `name`: used in messages.
std::vector<DeviceState> ReadStylusPath(RecordingReader& reader, const std::string& name,
                                        std::size_t longest = kLongestPathStates);

}  // namespace palpate
