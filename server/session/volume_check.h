// Checks a request to load a volume before the load. Does not need OpenVDB.
//
// Threads: any. Errors: Error (kInvalidArgument).
#pragma once

#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

// Throws if there is no such builtin volume.
void CheckBuiltinSource(const std::string& source);

void CheckVoxelSpacing(const Vec3& spacing_mm);

// Without `spacing_mm`, checks whether any spacing of a file could give voxels that can be felt.
void CheckScale(const std::string& source, const std::optional<Vec3>& spacing_mm,
                double device_mm_per_volume_mm);

}  // namespace palpate
