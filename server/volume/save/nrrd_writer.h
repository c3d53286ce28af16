// Writes volumes as NRRD: one file, of the smallest leaf type that holds all voxels, gzip, lengths
// in mm. The header names a space (LPS) only if the volume's is known.
//
// Any thread; not for real-time code.
#pragma once

#include <filesystem>
#include <functional>

#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// Writes `path`, replacing its contents. `progress` is called with the share done; it may throw to
// cancel. Throws std::ios_base::failure if the file cannot be written.
void WriteNrrd(const std::filesystem::path& path, const VolumeSnapshot& volume,
               const std::function<void(double fraction)>& progress);

}  // namespace palpate
