// A copy of the volume as an NRRD file: float, raw, in LPS.
//
// Threads: any. Errors: Error with kConflict for a file that is there,
// kPermissionDenied, kNotFound for its folder, kUnavailable for a full disk.
#pragma once

#include <functional>
#include <string>

#include "client/sdk/volume_mirror.h"

namespace palpate::cli {

// Throws what WriteNrrd would throw at once.
void CheckNrrdPath(const std::string& path, bool overwrite);

// `mirror` has a lattice. `check` is called now and then and may throw. The file is
// written beside its place and moved there whole.
void WriteNrrd(const VolumeMirror& mirror, const std::string& path, bool overwrite,
               const std::function<void()>& check);

}  // namespace palpate::cli
