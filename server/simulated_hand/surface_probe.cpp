#include "server/simulated_hand/surface_probe.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kCloseEnough = 1e-4;  // density

}  // namespace

double SurfaceProbe::At(const Vec3& p_D_mm) { return AtIndex(surface_.X_ID.Apply(p_D_mm)); }

double SurfaceProbe::AtIndex(const Vec3& p_I) {
  ++reads_;
  const Vec3 floor_I = p_I.array().floor();
  const Vec3 beyond = surface_.volume->size().cast<double>();
  if ((floor_I.array() < -1.0).any() || (floor_I.array() >= beyond.array()).any()) {
    return surface_.DensityOutside() - surface_.isovalue;
  }
  const Vec3i cell = floor_I.cast<int>();
  if (cell != cell_) {
    cell_ = cell;
    densities_ = surface_.Felt(surface_.volume->StoredCell(cell));
  }
  const Vec3 u = p_I - floor_I;
  double density = 0.0;
  for (int v = 0; v < 8; ++v) {
    const auto& o = kCornerOffset[v];
    density += densities_[v] * (o[0] ? u.x() : 1.0 - u.x()) * (o[1] ? u.y() : 1.0 - u.y()) *
               (o[2] ? u.z() : 1.0 - u.z());
  }
  return density - surface_.isovalue;
}

Vec3 SurfaceProbe::GradientAt(const Vec3& p_D_mm) {
  constexpr double kHalfVoxels = 0.75;
  const Vec3 p_I = surface_.X_ID.Apply(p_D_mm);
  Vec3 gradient_I;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 off = kHalfVoxels * Vec3::Unit(axis);
    gradient_I[axis] = (AtIndex(p_I + off) - AtIndex(p_I - off)) / (2.0 * kHalfVoxels);
  }
  // A covector.
  return surface_.X_ID.linear.transpose() * gradient_I;
}

Vec3 SurfaceProbe::NormalAt(const Vec3& p_D_mm) {
  const Vec3 gradient = GradientAt(p_D_mm);
  const double size = gradient.norm();
  return size > 0.0 ? Vec3(-gradient / size) : Vec3(Vec3::Zero());
}

// Brackets the crossing along the line, so that noise cannot send the point far away.
bool SurfaceProbe::Project(Vec3& p_D_mm, const Vec3& normal_D, double reach_mm) {
  const Vec3 start = p_D_mm;
  const double first = At(start);
  const double sign = first > 0.0 ? 1.0 : -1.0;
  double near_mm = 0.0, near_value = sign * first;
  for (const double share : {0.2, 1.0}) {
    double far_mm = share * reach_mm;
    double far_value = sign * At(start + sign * far_mm * normal_D);
    if (far_value > 0.0) {
      near_mm = far_mm;
      near_value = far_value;
      continue;
    }
    // Regula falsi, with half a step where one end stands still.
    constexpr int kSteps = 4;
    for (int n = 0; n < kSteps; ++n) {
      const double middle_mm =
          near_mm + (far_mm - near_mm) * near_value / std::max(near_value - far_value, 1e-12);
      p_D_mm = start + sign * middle_mm * normal_D;
      const double value = sign * At(p_D_mm);
      if (std::abs(value) < kCloseEnough) break;
      if (value > 0.0) {
        near_mm = middle_mm;
        near_value = value;
        far_value *= 0.5;
      } else {
        far_mm = middle_mm;
        far_value = value;
        near_value *= 0.5;
      }
    }
    return true;
  }
  return false;
}

bool SurfaceProbe::IsInLattice(const Vec3& p_D_mm) const {
  const Vec3 p_I = surface_.X_ID.Apply(p_D_mm);
  return (p_I.array() >= -1.0).all() &&
         (p_I.array() <= surface_.volume->size().cast<double>().array()).all();
}

}  // namespace palpate
