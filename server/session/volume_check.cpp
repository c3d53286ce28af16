#include "server/session/volume_check.h"

#include <algorithm>

#include "server/felt/registration.h"
#include "server/session/setting_checks.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/volume_metadata.h"

namespace palpate {

void CheckBuiltinSource(const std::string& source) { BuiltinSize(source); }

void CheckVoxelSpacing(const Vec3& spacing_mm) {
  for (const double spacing : spacing_mm) {
    CheckRange("voxel spacing", spacing, kLeastSpacingMm, kGreatestSpacingMm, " mm");
  }
}

void CheckScale(const std::string& source, const std::optional<Vec3>& spacing_mm,
                double device_mm_per_volume_mm) {
  // The file's spacing is unknown: assumes the spacing that fits best.
  const double of_file =
      std::clamp(1.0 / device_mm_per_volume_mm, kLeastSpacingMm, kGreatestSpacingMm);
  VolumeMetadata volume;
  volume.size = Vec3i::Constant(2);
  volume.spacing_mm =
      spacing_mm.value_or(IsBuiltin(source) ? Vec3::Ones() : Vec3::Constant(of_file));
  MakeVolumePlace(volume, Vec3::Zero(), Eigen::Quaterniond::Identity(), device_mm_per_volume_mm);
}

}  // namespace palpate
