#include "server/session/registration.h"

#include "common/error/error.h"

namespace palpate {
namespace {

// Voxels of other sizes cannot be felt; their arithmetic would overflow one day.
constexpr double kLeastVoxelMm = 1e-6;
constexpr double kGreatestVoxelMm = 1e6;

}  // namespace

Registration FitToWorkspace(const VolumeMetadata& volume, const DeviceSpec& device,
                            std::optional<double> device_mm_per_volume_mm) {
  const AffineMap X_WI = volume.WorldFromIndex();
  const Vec3 last = (volume.size - Vec3i::Ones()).cast<double>();
  Vec3 low = X_WI.translation, high = low;
  for (int corner = 1; corner < 8; ++corner) {
    const Vec3 p_I(corner & 1 ? last.x() : 0, corner & 2 ? last.y() : 0, corner & 4 ? last.z() : 0);
    const Vec3 p_W = X_WI.Apply(p_I);
    low = low.cwiseMin(p_W);
    high = high.cwiseMax(p_W);
  }
  const Vec3 workspace = device.workspace_max_mm - device.workspace_min_mm;
  Registration registration;
  const double scale = device_mm_per_volume_mm.value_or(
      kWorkspaceFill * (workspace.array() / (high - low).array()).minCoeff());
  const Vec3 voxel_mm = scale * volume.spacing_mm;
  if (!(voxel_mm.minCoeff() >= kLeastVoxelMm && voxel_mm.maxCoeff() <= kGreatestVoxelMm)) {
    throw Error(ErrorKind::kInvalidArgument,
                "the scale must make a voxel 1e-6 to 1e6 mm long in the device's workspace");
  }
  registration.device_mm_per_volume_mm = scale;
  registration.X_DW.linear = Mat3::Identity() * scale;
  registration.X_DW.translation =
      0.5 * (device.workspace_min_mm + device.workspace_max_mm) - scale * 0.5 * (low + high);
  return registration;
}

}  // namespace palpate
