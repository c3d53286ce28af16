// Writes a downloaded volume as an NRRD file: float, raw, in LPS.
//
// Threads: any. Errors: kConflict (the file exists), kInvalidArgument (no regular file: a folder, a
// link), kNotFound (no such folder for the file), kPermissionDenied, kDiskFull.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/volume_mirror.h"

namespace palpate::client {

// Throws what SaveAsNrrd would throw at once. Call it before a download.
void CheckNrrdPath(const std::string& path, bool overwrite);

// `volume` must have a lattice. `check` is called now and then and may throw. The file is written
// next to its place and then renamed, so that it is always complete.
void SaveAsNrrd(const VolumeMirror& volume, const std::string& path, bool overwrite = false,
                const std::function<void()>& check = {});

}  // namespace palpate::client
