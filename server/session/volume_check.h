// What can be wrong with a volume that is to be loaded, before it is; for those who may
// not know OpenVDB.
//
// Threads: any. Errors: Error (kInvalidArgument).
#pragma once

#include <optional>
#include <string>

#include "common/geometry/geometry.h"

namespace palpate {

// Throws where there is no such builtin volume.
void CheckBuiltinSource(const std::string& source);

void CheckVoxelSpacing(const Vec3& spacing_mm);

// Without a spacing: whether that of a file could make voxels that can be felt.
void CheckScale(const std::string& source, const std::optional<Vec3>& spacing_mm,
                double device_mm_per_volume_mm);

}  // namespace palpate
