#include "server/import/image_geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/SVD>

namespace palpate {
namespace {

Vec3 LastVoxel(const std::array<std::int64_t, 3>& size) {
  return Vec3(static_cast<double>(size[0]), static_cast<double>(size[1]),
              static_cast<double>(size[2])) -
         Vec3::Ones();
}

}  // namespace

AffineMap MapOf(const ImageGeometry& geometry) {
  return {geometry.direction * geometry.spacing_mm.asDiagonal(), geometry.origin_W_mm};
}

PlaceError FarthestCorner(const AffineMap& X_WI, const AffineMap& other_WI,
                          const std::array<std::int64_t, 3>& size) {
  const Vec3 last = LastVoxel(size);
  const Mat3 to_index = X_WI.linear.inverse();
  PlaceError greatest;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 at_I = last.cwiseProduct(Vec3(corner & 1, (corner >> 1) & 1, (corner >> 2) & 1));
    const Vec3 apart_mm = other_WI.Apply(at_I) - X_WI.Apply(at_I);
    const PlaceError error{(to_index * apart_mm).cwiseAbs().maxCoeff(), apart_mm.norm()};
    if (!std::isfinite(error.voxels + error.mm)) {
      return {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    }
    greatest = {std::max(greatest.voxels, error.voxels), std::max(greatest.mm, error.mm)};
  }
  return greatest;
}

void RepairSpacing(bool spacing_is_given, ImageHeader* header) {
  ImageGeometry& geometry = header->geometry;
  if (!geometry.has_spacing && !spacing_is_given) {
    header->warnings.push_back(
        "the header does not state the spacing of each axis; 1 mm is taken where it is missing, "
        "give it with --spacing-mm");
  }
  for (int k = 0; k < 3; ++k) {
    if (geometry.spacing_mm[k] >= 0.0) continue;
    geometry.spacing_mm[k] *= -1.0;
    geometry.direction.col(k) *= -1.0;
    header->warnings.push_back("the spacing along " + std::string(1, "xyz"[k]) +
                               " is negative; the axis is turned around, as ITK does");
  }
}

PlaceError Straighten(const std::array<std::int64_t, 3>& size, ImageGeometry* geometry) {
  const AffineMap sheared = MapOf(*geometry);
  const Vec3 middle_I = 0.5 * LastVoxel(size);
  const Eigen::JacobiSVD<Mat3> svd(geometry->direction, Eigen::ComputeFullU | Eigen::ComputeFullV);
  geometry->direction = svd.matrixU() * svd.matrixV().transpose();
  geometry->origin_W_mm = sheared.Apply(middle_I) - MapOf(*geometry).linear * middle_I;
  return FarthestCorner(MapOf(*geometry), sheared, size);
}

}  // namespace palpate
