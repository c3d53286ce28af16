// Writes a downloaded volume as an NRRD file: dense, raw, of the smallest type that holds all
// voxels (uint8, int16, uint16, float). The header names a space, LPS, only if the volume's file
// stated one.
//
// Threads: any. Errors: kTooLarge (CheckNrrdSize), kConflict (the file exists), kInvalidArgument
// (no regular file: a folder, a link), kNotFound (no such folder for the file), kPermissionDenied,
// kDiskFull.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/volume_mirror.h"

namespace palpate::client {

// Throws kTooLarge if the voxels take more than 16 GiB. A sparse volume of such a size is mostly
// background, which NRRD would write out.
void CheckNrrdSize(const Vec3i& size, LeafType type);

// Throws what SaveAsNrrd would throw at once. Call it before a download.
void CheckNrrdPath(const std::string& path, bool overwrite);

// `volume` must have a lattice. `check` is called now and then and may throw. The file is written
// next to its place and then renamed, so that it is always complete.
void SaveAsNrrd(const VolumeMirror& volume, const std::string& path, bool overwrite = false,
                const std::function<void()>& check = {});
// The same, of bricks. `is_lps`: the volume's file stated an orientation.
void SaveAsNrrd(const BrickMap& bricks, const VolumeLattice& lattice, bool is_lps,
                const std::string& path, bool overwrite = false,
                const std::function<void()>& check = {});

}  // namespace palpate::client
