#include "client/view/drawing/cut_rulers.h"

#include <algorithm>

#include "client/view/drawing/cut_handles.h"

namespace palpate::view {
namespace {

double VoxelsPerMm(const Vec3& normal_I, const AffineMap& X_WI) {
  return (X_WI.Inverse().linear.transpose() * normal_I).norm();
}

double OffsetOfMiddle(const Vec3& normal_I, const Vec3i& lattice_size) {
  return 0.5 * normal_I.dot((lattice_size - Vec3i::Ones()).cast<double>());
}

}  // namespace

std::array<CutRuler, 3> RulersOf(const AffineMap& X_PI, const Vec3i& lattice_size) {
  const PatientAxes axes = NearestAxes(X_PI.linear);
  std::array<CutRuler, 3> rulers;
  for (std::size_t n = 0; n < rulers.size(); ++n) {
    const SignedAxis& along_I = axes[n];
    const Vec3 unit_P = along_I.sign * X_PI.linear.col(along_I.axis).normalized();
    const auto at = [&](double fraction) {
      Vec3 p_I = Vec3::Zero();
      p_I[along_I.axis] = PointOfFractions(Vec3::Constant(fraction), lattice_size)[along_I.axis];
      return unit_P.dot(X_PI.Apply(p_I));
    };
    rulers[n] = {.along_I = along_I,
                 .begin_mm = at(along_I.sign > 0 ? 0.0 : 1.0),
                 .end_mm = at(along_I.sign > 0 ? 1.0 : 0.0)};
  }
  return rulers;
}

std::array<double, 2> FacesOnRuler(const CropBox& crop, const CutRuler& ruler) {
  const int axis = ruler.along_I.axis;
  const double length_mm = ruler.end_mm - ruler.begin_mm;
  if (ruler.along_I.sign > 0) {
    return {ruler.begin_mm + crop.min[axis] * length_mm,
            ruler.begin_mm + crop.max[axis] * length_mm};
  }
  return {ruler.end_mm - crop.max[axis] * length_mm, ruler.end_mm - crop.min[axis] * length_mm};
}

void SetFacesOnRuler(const std::array<double, 2>& faces_mm, const CutRuler& ruler, CropBox& crop) {
  const int axis = ruler.along_I.axis;
  const double length_mm = ruler.end_mm - ruler.begin_mm;
  double low = (faces_mm[0] - ruler.begin_mm) / length_mm;
  double high = (faces_mm[1] - ruler.begin_mm) / length_mm;
  if (ruler.along_I.sign < 0) {
    low = (ruler.end_mm - faces_mm[1]) / length_mm;
    high = (ruler.end_mm - faces_mm[0]) / length_mm;
  }
  crop.min[axis] = std::clamp(low, 0.0, 1.0 - kLeastCrop);
  crop.max[axis] = std::clamp(high, crop.min[axis] + kLeastCrop, 1.0);
}

double DistanceOfPlane(double offset_voxels, const Vec3& normal_I, const AffineMap& X_WI,
                       const Vec3i& lattice_size) {
  return (offset_voxels - OffsetOfMiddle(normal_I, lattice_size)) / VoxelsPerMm(normal_I, X_WI);
}

double OffsetOfPlane(double distance_mm, const Vec3& normal_I, const AffineMap& X_WI,
                     const Vec3i& lattice_size) {
  return distance_mm * VoxelsPerMm(normal_I, X_WI) + OffsetOfMiddle(normal_I, lattice_size);
}

}  // namespace palpate::view
