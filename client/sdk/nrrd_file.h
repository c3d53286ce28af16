// A downloaded volume as an NRRD file: float, raw, in LPS.
//
// Threads: any. Errors: Error with kConflict for a file that is there, kInvalidArgument for a
// folder, kPermissionDenied, kNotFound for its folder, kDiskFull.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/volume_mirror.h"

namespace palpate::client {

// Throws what SaveAsNrrd would throw at once: for before a volume travels.
void CheckNrrdPath(const std::string& path, bool overwrite);

// `volume` has a lattice. `check` is called now and then and may throw. The file is
// written beside its place and moved there whole.
void SaveAsNrrd(const VolumeMirror& volume, const std::string& path, bool overwrite = false,
                const std::function<void()>& check = {});

}  // namespace palpate::client
