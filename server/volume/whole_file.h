// Files that are either whole or as they were.
//
// Any thread; not for real-time code.
#pragma once

#include <filesystem>
#include <functional>

namespace palpate {

enum class IfThere { kReplace, kRefuse };

// Has `write` fill a file beside `path`, which then takes its place. `write` throws
// std::ios_base::failure where it cannot, or any Error. Throws that Error,
// kUnavailable, or kConflict where the file is there and not to be replaced:
// nothing is left behind and `path` is as it was. One writer of a path at a time.
void WriteWhole(const std::filesystem::path& path,
                const std::function<void(const std::filesystem::path& partial)>& write,
                IfThere if_there = IfThere::kReplace);

// Throws Error (kPermissionDenied) where `partial` is a link: writing to it would
// overwrite the file that it leads to. Devices are not harmed by it.
void RefuseLink(const std::filesystem::path& partial);

// Returns when the file is on the disk, so that it outlives a loss of power. Throws
// std::ios_base::failure.
void Sync(const std::filesystem::path& file);

}  // namespace palpate
