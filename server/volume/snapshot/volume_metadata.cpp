#include "server/volume/snapshot/volume_metadata.h"

#include <fmt/core.h>

#include <cmath>
#include <limits>

#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate {
namespace {

constexpr double kFrameTolerance = 1e-3;
// Map coordinates in mm are up to 1e10.
constexpr double kFarthest_mm = 1e12;

}  // namespace

std::pair<double, double> VolumeMetadata::EditRange() const {
  struct Type {
    const char* name;
    double least, greatest;
  };
  constexpr Type kTypes[] = {
      {"int8", -128, 127}, {"uint8", 0, 255}, {"int16", -32768, 32767}, {"uint16", 0, 65535}};
  for (const auto& [name, least, greatest] : kTypes) {
    // A file may scale its voxels.
    const bool is_own = original_type == name && value_min >= least && value_max <= greatest &&
                        value_min == std::floor(value_min) && value_max == std::floor(value_max);
    if (is_own && !is_level_set) return {least, greatest};
  }
  return {value_min, value_max};
}

std::string ShapeText(const Vec3i& size, const Vec3& spacing_mm) {
  return fmt::format("{} x {} x {} voxels of {} x {} x {} mm", size.x(), size.y(), size.z(),
                     NumberText(spacing_mm.x()), NumberText(spacing_mm.y()),
                     NumberText(spacing_mm.z()));
}

void CheckVolumeMetadata(const VolumeMetadata& metadata) {
  constexpr int kLongestAxis = std::numeric_limits<int>::max() / 2;
  if (metadata.size.minCoeff() < 2 || metadata.size.maxCoeff() > kLongestAxis) {
    Refuse("the size is not that of a volume; every axis needs at least two voxels");
  }
  for (const double spacing : metadata.spacing_mm) {
    if (!(spacing >= kLeastSpacingMm && spacing <= kGreatestSpacingMm)) {
      Refuse("the voxel spacing " + std::to_string(spacing) +
             " mm is not between 0.0001 and 1000000 mm; state another one (spacing-mm)");
    }
  }
  if (!metadata.origin_W_mm.allFinite()) Refuse("the origin is not finite; correct the file");
  if (metadata.origin_W_mm.cwiseAbs().maxCoeff() > kFarthest_mm) {
    Refuse("the origin is farther than 1e12 mm from the world's; correct the file");
  }
  const Mat3 gram = metadata.direction.transpose() * metadata.direction;
  if (!gram.allFinite() || !gram.isApprox(Mat3::Identity(), kFrameTolerance)) {
    Refuse("the axes are not at right angles (sheared); resample the volume first");
  }
  if (!std::isfinite(metadata.value_min) || !std::isfinite(metadata.value_max) ||
      !(metadata.value_min < metadata.value_max)) {
    Refuse("all voxels have the same value (constant volume); there is nothing to feel");
  }
  if (!std::isfinite(metadata.window_level) || !(metadata.window_width >= 0.0)) {
    Refuse("the window of the values is not a level and a width");
  }
  if (!metadata.patient_axes.empty() && !IsPatientAxes(metadata.patient_axes)) {
    Refuse("the patient's axes are not three of L, R, P, A, S, I, one of each pair");
  }
  if (metadata.frames < 1) Refuse("the number of frames is not positive; correct the file");
  for (const std::string* text : {&metadata.unit, &metadata.original_type, &metadata.source}) {
    if (text->size() > kLongestText) Refuse("a text of the metadata is too long");
  }
}

}  // namespace palpate
