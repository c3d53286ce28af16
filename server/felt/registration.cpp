#include "server/felt/registration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/error/error.h"
#include "common/geometry/geometry.h"

namespace palpate {
namespace {

// More than rounding to float changes the norm of a unit quaternion.
constexpr double kUnitTolerance = 1e-3;
constexpr double kUnitRounding = 1e-15;

Eigen::Quaterniond CheckedRotation(const Eigen::Quaterniond& rotation) {
  const double norm = rotation.norm();
  // The condition is false for NaN.
  if (!(std::abs(norm - 1.0) <= kUnitTolerance)) {
    Refuse("a rotation must be a unit quaternion w, x, y, z");
  }
  Eigen::Quaterniond unit = rotation;
  // A quaternion that is a unit already keeps its bits.
  if (std::abs(norm - 1.0) > kUnitRounding) unit.coeffs() /= norm;
  // q and -q are the same rotation. One of them is used, so that equal rotations read the same.
  if (unit.w() < 0.0) unit.coeffs() = -unit.coeffs();
  return unit;
}

double ChosenScale(const UpdateRegistrationRequest& update, const VolumeMetadata& volume,
                   const VolumePlace& current) {
  if (update.device_mm_per_volume_mm && update.device_mm_per_voxel) {
    Refuse("give the scale per mm of the volume or per voxel, not both");
  }
  if (update.device_mm_per_voxel) {
    return *update.device_mm_per_voxel / volume.spacing_mm.minCoeff();
  }
  return update.device_mm_per_volume_mm.value_or(current.device_mm_per_volume_mm);
}

}  // namespace

Vec3 VolumeCenterMm(const VolumeMetadata& volume) {
  const Vec3 last = (volume.size - Vec3i::Ones()).cast<double>();
  return volume.WorldFromIndex().Apply(0.5 * last);
}

double DeviceMmPerVoxel(const VolumePlace& registration, const VolumeMetadata& volume) {
  return registration.device_mm_per_volume_mm * volume.spacing_mm.minCoeff();
}

VolumePlace MakeVolumePlace(const VolumeMetadata& volume, const Vec3& p_DCenter_mm,
                            const Eigen::Quaterniond& R_DW, double device_mm_per_volume_mm) {
  const double scale = device_mm_per_volume_mm;
  const Vec3 voxel_mm = scale * volume.spacing_mm;
  if (!(voxel_mm.minCoeff() >= kLeastVoxelMm && voxel_mm.maxCoeff() <= kGreatestVoxelMm)) {
    Refuse("the scale must make a voxel 1e-6 to 1e6 mm long in the device's workspace");
  }
  if (!p_DCenter_mm.allFinite() || p_DCenter_mm.cwiseAbs().maxCoeff() > kFarthestCenterMm) {
    Refuse("the volume's centre must be within 1e6 mm of the device's origin");
  }
  VolumePlace registration;
  registration.device_mm_per_volume_mm = scale;
  registration.p_DCenter_mm = p_DCenter_mm;
  registration.R_DW = CheckedRotation(R_DW);
  registration.X_DW.linear = scale * registration.R_DW.toRotationMatrix();
  registration.X_DW.translation = p_DCenter_mm - registration.X_DW.linear * VolumeCenterMm(volume);
  return registration;
}

VolumePlace FitToWorkspace(const VolumeMetadata& volume, const DeviceDescription& device,
                           std::optional<double> device_mm_per_volume_mm) {
  // Half the edges of the box around the lattice, along W's axes.
  const Vec3 half_mm = 0.5 * (volume.WorldFromIndex().linear.cwiseAbs() *
                              (volume.size - Vec3i::Ones()).cast<double>());
  const Vec3 workspace = device.workspace_max_mm - device.workspace_min_mm;
  const double scale = device_mm_per_volume_mm.value_or(
      kWorkspaceFill * (workspace.array() / (2.0 * half_mm).array()).minCoeff());
  return MakeVolumePlace(volume, 0.5 * (device.workspace_min_mm + device.workspace_max_mm),
                         Eigen::Quaterniond::Identity(), scale);
}

VolumePlace Apply(const UpdateRegistrationRequest& update, const VolumeMetadata& volume,
                  const DeviceDescription& device, const VolumePlace& current) {
  const VolumePlace from = update.reset ? FitToWorkspace(volume, device, std::nullopt) : current;
  const VolumePlace placed =
      MakeVolumePlace(volume, update.center_mm.value_or(from.p_DCenter_mm),
                      update.rotation ? Eigen::Quaterniond(*update.rotation) : from.R_DW,
                      ChosenScale(update, volume, from));
  Vec3 p_DCenter_mm = placed.p_DCenter_mm;
  Eigen::Quaterniond R_DW = placed.R_DW;
  if (update.translate_mm) p_DCenter_mm += *update.translate_mm;
  if (update.rotate) R_DW = CheckedRotation(Eigen::Quaterniond(*update.rotate)) * R_DW;
  const double scale_by = update.scale_by.value_or(1.0);
  return MakeVolumePlace(volume, p_DCenter_mm, R_DW, scale_by * placed.device_mm_per_volume_mm);
}

namespace {

constexpr std::array<const char*, 6> kDirections = {"+x", "-x", "+y", "-y", "+z", "-z"};

Vec3 DirectionOf(const std::string& word, const char* field) {
  const auto found = std::find(kDirections.begin(), kDirections.end(), word);
  if (found == kDirections.end()) {
    Refuse(std::string("facing.") + field + " must be +x, -x, +y, -y, +z or -z, not '" + word +
           "'");
  }
  const auto place = found - kDirections.begin();
  return (place % 2 == 0 ? 1.0 : -1.0) * Vec3::Unit(place / 2);
}

}  // namespace

std::string PatientAxesOf(const PatientFacing& facing) {
  const Vec3 anterior = DirectionOf(facing.face, "face");
  const Vec3 superior = DirectionOf(facing.head, "head");
  const Vec3 left = superior.cross(anterior);
  if (left.isZero(0.0)) Refuse("face and head must point along two different axes");
  std::string axes;
  for (int axis = 0; axis < 3; ++axis) {
    for (const auto& [direction, letters] :
         {std::pair(left, "LR"), std::pair(anterior, "AP"), std::pair(superior, "SI")}) {
      if (direction[axis] != 0.0) axes += letters[direction[axis] > 0.0 ? 0 : 1];
    }
  }
  return axes;
}

bool IsAnsweredAxes(std::string_view axes) {
  for (const char* face : kDirections) {
    for (const char* head : kDirections) {
      if (face[1] != head[1] && PatientAxesOf({face, head}) == axes) return true;
    }
  }
  return false;
}

}  // namespace palpate
