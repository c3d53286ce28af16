#include "server/pump/touched_point.h"

#include <limits>

#include "common/geometry/sphere_directions.h"

namespace palpate {
namespace {

constexpr int kDirections = 200;
constexpr double kFirstStep = 0.15;  // rad; about the distance of two directions
constexpr double kLastStep = 1e-3;
constexpr int kMostSteps = 40;
// How far V can be beyond the sphere, in longest voxel edges.
constexpr double kBeyondVoxels = 1.5;
constexpr int kOtherWays = 64;

class OnSphere {
 public:
  OnSphere(const HapticSurface& surface, const Vec3& center_D_mm, double radius_mm)
      : surface_(surface),
        center_I_(surface.X_ID.Apply(center_D_mm)),
        radius_I_(radius_mm * surface.X_ID.linear) {}

  double Density(const Vec3& direction_D) {
    At(direction_D);
    return f_.Value(local_);
  }
  // Of the density with the direction.
  Vec3 Gradient(const Vec3& direction_D) {
    At(direction_D);
    return radius_I_.transpose() * f_.Gradient(local_);
  }

 private:
  void At(const Vec3& direction_D) {
    const Vec3 p_I = center_I_ + radius_I_ * direction_D;
    const Vec3i cell = p_I.array().floor().cast<int>();
    if (cell != cell_) f_ = Trilinear(surface_.Felt(surface_.volume->StoredCell(cell)));
    cell_ = cell;
    local_ = p_I - cell.cast<double>();
  }

  const HapticSurface& surface_;
  const Vec3 center_I_;
  const Mat3 radius_I_;
  Vec3i cell_ = Vec3i::Constant(std::numeric_limits<int>::min());
  Trilinear f_{CellDensities{}};
  Vec3 local_;
};

Vec3 Highest(OnSphere& sphere) {
  Vec3 highest = Vec3::UnitZ();
  double most = -std::numeric_limits<double>::infinity();
  VisitDirections(kDirections, [&](const Vec3& direction) {
    const double density = sphere.Density(direction);
    if (density > most) most = density, highest = direction;
  });
  // Up the slope, by shorter steps where one does not lead up.
  double step = kFirstStep;
  for (int n = 0; n < kMostSteps && step > kLastStep; ++n) {
    Vec3 up = sphere.Gradient(highest);
    up -= up.dot(highest) * highest;
    if (!(up.norm() > 0.0)) break;
    const Vec3 next = (highest + step * up.normalized()).normalized();
    const double density = sphere.Density(next);
    if (density > most) {
      most = density, highest = next;
    } else {
      step *= 0.5;
    }
  }
  return highest;
}

}  // namespace

VisualProxy FindTouchedPoint(const HapticSurface& surface, const Vec3& center_D_mm,
                             double radius_mm) noexcept {
  OnSphere sphere(surface, center_D_mm, radius_mm);
  const double reach_mm = radius_mm + kBeyondVoxels * surface.longest_voxel_mm;
  const VisualProxy touched = FirstOnWay(surface, center_D_mm, Highest(sphere), reach_mm);
  if (touched.found) return touched;
  // Where values jump from one voxel to the next, V is not on that way.
  VisualProxy nearest;
  double nearest_mm = reach_mm;
  VisitDirections(kOtherWays, [&](const Vec3& direction) {
    const VisualProxy other = FirstOnWay(surface, center_D_mm, direction, nearest_mm);
    if (!other.found) return;
    nearest = other;
    nearest_mm = (other.p_DV_mm - center_D_mm).norm();
  });
  return nearest;
}

}  // namespace palpate
