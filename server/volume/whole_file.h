// Files that are either whole or as they were.
//
// Any thread; not for real-time code.
#pragma once

#include <filesystem>
#include <functional>

namespace palpate {

// Has `write` fill a file beside `path`, which then takes its place. `write` throws
// std::ios_base::failure where it cannot. Throws Error(kUnavailable): nothing is
// left behind and `path` is as it was.
void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write);

}  // namespace palpate
