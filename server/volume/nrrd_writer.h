// Volumes as NRRD: one file, in the smallest type of leaves that holds all voxels, gzip, frame LPS
// in mm.
//
// Any thread; not for real-time code.
#pragma once

#include <filesystem>
#include <functional>

#include "server/volume/snapshot.h"

namespace palpate {

// Fills `path` anew. `progress` is told the share that is done, and gives up by
// throwing. Throws std::ios_base::failure where it cannot write.
void WriteNrrd(const std::filesystem::path& path, const VolumeSnapshot& volume,
               const std::function<void(double fraction)>& progress);

}  // namespace palpate
