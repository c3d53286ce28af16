// Finds the files of a time series that a client has named.
//
// Threads: any; asks the file system.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/client_paths/path_policy.h"

namespace palpate {

// A series with more frames is refused.
inline constexpr std::size_t kMostFrames = 10'000;

// Throws kTooLarge above kMostFrames.
void CheckFrames(std::size_t frames);

// Returns absolute paths, with links followed, in the order of time. The last part of a source may
// be a pattern with * and ?. The matches are ordered by the numbers in their names.
// Throws Error: kInvalidArgument (no source, a pattern without a match, a builtin volume),
// kTooLarge (too many files), and as PathPolicy::CheckLoad.
std::vector<std::filesystem::path> FindSeriesFiles(std::span<const std::string> sources,
                                                   const PathPolicy& paths);

// Compares names; runs of digits compare as numbers: t9 comes before t10. A strict order: only
// equal names are equal.
bool ComesBefore(std::string_view a, std::string_view b);

}  // namespace palpate
