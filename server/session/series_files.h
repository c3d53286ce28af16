// The files of a time series, from what a client named.
//
// Threads: any; asks the file system.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/session/path_policy.h"

namespace palpate {

// More frames are refused.
inline constexpr std::size_t kMostFrames = 10'000;

// Absolute paths, links followed, in the order of time. The last part of a source may
// be a pattern with * and ?: its matches come in the order of the numbers in their
// names.
// Throws Error: kInvalidArgument (no source, a pattern without a match, a builtin
// volume), kTooLarge (too many), and as PathPolicy::CheckLoad.
std::vector<std::filesystem::path> FindSeriesFiles(std::span<const std::string> sources,
                                                   const PathPolicy& paths);

// Runs of digits compare as the numbers that they are: t9 comes before t10. A strict
// order: equal only for equal names.
bool ComesBefore(std::string_view a, std::string_view b);

}  // namespace palpate
