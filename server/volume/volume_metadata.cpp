#include "server/volume/volume_metadata.h"

#include <cmath>
#include <limits>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr double kFrameTolerance = 1e-3;

}  // namespace

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
  if (!metadata.origin_W_mm.allFinite() || metadata.origin_W_mm.cwiseAbs().maxCoeff() > 1e9) {
    Refuse("the origin is not finite; correct the file");
  }
  const Mat3 gram = metadata.direction.transpose() * metadata.direction;
  if (!gram.allFinite() || !gram.isApprox(Mat3::Identity(), kFrameTolerance)) {
    Refuse("the axes are not at right angles (sheared); resample the volume first");
  }
  if (!std::isfinite(metadata.value_min) || !std::isfinite(metadata.value_max) ||
      !(metadata.value_min < metadata.value_max)) {
    Refuse("all voxels have the same value (constant volume); there is nothing to feel");
  }
  if (metadata.frames < 1) Refuse("the number of frames is not positive; correct the file");
  for (const std::string* text : {&metadata.unit, &metadata.original_type, &metadata.source}) {
    if (text->size() > kLongestText) Refuse("a text of the metadata is too long");
  }
}

}  // namespace palpate
