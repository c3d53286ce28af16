#include "server/lab/surface_walker.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/error/error.h"
#include "server/lab/gbid.h"

namespace palpate::lab {
namespace {

constexpr double kStepVoxels = 0.25;
constexpr double kNormalVoxels = 1.0;  // the normal is averaged over this length
// The margin in which the walk turns round, in addition to the lift: a stylus below the walker must
// not meet the volume's border.
constexpr double kMarginVoxels = 4.0;
constexpr double kOnSurface = 1e-9;  // of the range
constexpr int kMostCorrections = 12;
constexpr int kMostStarts = 100'000;
constexpr int kMostHeadings = 64;
constexpr int kLiftSamples = 16;
// The heading turns by up to kTurnPerMm (rad per mm), with a period of kTurnLengthMm.
constexpr double kTurnPerMm = 0.08;
constexpr double kTurnLengthMm = 37.0;

Vec3 InTangentPlane(const Vec3& v, const Vec3& normal) { return v - v.dot(normal) * normal; }

}  // namespace

SurfaceWalker::SurfaceWalker(const VolumeSnapshot& volume, double isovalue, double lift_mm,
                             std::uint64_t seed)
    : volume_(volume),
      isovalue_(isovalue),
      lift_mm_(lift_mm),
      X_WI_(volume.metadata().WorldFromIndex()),
      X_IW_(X_WI_.Inverse()),
      voxel_mm_(volume.metadata().spacing_mm.minCoeff()),
      random_(seed) {
  const Vec3 lift_voxels = lift_mm * volume.metadata().spacing_mm.cwiseInverse();
  // In a thin volume, the margins take at most half of the volume.
  margin_voxels_ =
      (lift_voxels.array() + kMarginVoxels).min(volume.size().cast<double>().array() / 4.0);
  Restart();
}

double SurfaceWalker::Random(double low, double high) {
  return low + (high - low) * (static_cast<double>(random_() >> 11) * 0x1p-53);
}

bool SurfaceWalker::IsInside(const Vec3& p_mm, const Vec3& margin_voxels) const {
  const Vec3 p_I = X_IW_.Apply(p_mm);
  const Vec3 last = (volume_.size() - Vec3i::Ones()).cast<double>();
  return (p_I.array() >= margin_voxels.array()).all() &&
         (p_I.array() <= (last - margin_voxels).array()).all();
}

// Moves p to V along the gradient.
SurfaceWalker::Foot SurfaceWalker::FindFoot(Vec3 p_mm, double reach_mm) const {
  const Vec3 start_mm = p_mm;
  for (int n = 0; n < kMostCorrections; ++n) {
    if (!IsInside(p_mm, Vec3::Zero()) || (p_mm - start_mm).norm() > reach_mm) break;
    const FieldSample sample = SampleField(volume_, X_IW_.Apply(p_mm));
    const Vec3 gradient_per_mm = X_IW_.linear.transpose() * sample.gradient;
    const double squared = gradient_per_mm.squaredNorm();
    if (!(squared > 0.0)) break;
    const double error = sample.value - isovalue_;
    if (std::abs(error) <= kOnSurface) return {true, p_mm, -gradient_per_mm / std::sqrt(squared)};
    p_mm -= error / squared * gradient_per_mm;
  }
  return {};
}

bool SurfaceWalker::IsFreeAbove(const Foot& foot) const {
  for (int n = 1; n <= kLiftSamples; ++n) {
    const Vec3 p_mm = foot.p_mm + lift_mm_ * n / kLiftSamples * foot.normal;
    if (!IsInside(p_mm, Vec3::Zero())) return false;
    if (SampleField(volume_, X_IW_.Apply(p_mm)).value >= isovalue_) return false;
  }
  return true;
}

// Takes the first crossing on a line from the border inwards. A pocket inside the object would be a
// wrong start: no stylus reaches it.
std::optional<Vec3> SurfaceWalker::FindFromBorder() {
  const Vec3 last = (volume_.size() - Vec3i::Ones()).cast<double>();
  const int axis = static_cast<int>(Random(0.0, 3.0));
  const bool upwards = Random(0.0, 1.0) < 0.5;
  Vec3 p_I;
  for (int other = 0; other < 3; ++other) p_I[other] = Random(0.0, last[other]);
  constexpr double kSearchVoxels = 0.5;
  for (double way = 0.0; way <= last[axis]; way += kSearchVoxels) {
    p_I[axis] = upwards ? way : last[axis] - way;
    if (SampleField(volume_, p_I).value > isovalue_) return X_WI_.Apply(p_I);
  }
  return std::nullopt;
}

void SurfaceWalker::Restart() {
  for (int n = 0; n < kMostStarts; ++n) {
    const std::optional<Vec3> p_mm = FindFromBorder();
    if (!p_mm || !IsInside(*p_mm, margin_voxels_)) continue;
    const Foot foot = FindFoot(*p_mm, 2.0 * voxel_mm_);
    if (!foot.found || !IsInside(foot.p_mm, margin_voxels_) || !IsFreeAbove(foot)) continue;
    p_mm_ = foot.p_mm;
    foot_normal_ = normal_ = foot.normal;
    const Vec3 any(Random(-1.0, 1.0), Random(-1.0, 1.0), Random(-1.0, 1.0));
    heading_ = InTangentPlane(any, foot_normal_).normalized();
    if (heading_.allFinite()) return;
  }
  throw Error(ErrorKind::kInvalidArgument,
              "no place on the surface with free space above it; try another isovalue");
}

bool SurfaceWalker::TryHeading(const Vec3& heading, double length_mm) {
  const Foot foot = FindFoot(p_mm_ + length_mm * heading, 2.0 * length_mm);
  if (!foot.found || (foot.p_mm - p_mm_).norm() < 0.25 * length_mm) return false;
  const Vec3 onwards = InTangentPlane(heading, foot.normal);
  if (!(onwards.norm() > 0.0)) return false;
  const bool returns = IsInside(p_mm_, margin_voxels_) && !IsInside(foot.p_mm, margin_voxels_);
  if (returns) return false;
  p_mm_ = foot.p_mm;
  foot_normal_ = foot.normal;
  heading_ = onwards.normalized();
  const double share = std::min(1.0, length_mm / (kNormalVoxels * voxel_mm_));
  normal_ += share * (foot.normal - normal_);
  return normal_.norm() > 0.0;
}

bool SurfaceWalker::Step(double length_mm) {
  walked_mm_ += length_mm;
  const double turn =
      kTurnPerMm * length_mm * std::sin(2.0 * std::numbers::pi * walked_mm_ / kTurnLengthMm);
  const Vec3 heading = InTangentPlane(heading_, foot_normal_).normalized();
  if (TryHeading(heading + turn * foot_normal_.cross(heading), length_mm)) return true;
  for (int n = 0; n < kMostHeadings; ++n) {
    const Vec3 any(Random(-1.0, 1.0), Random(-1.0, 1.0), Random(-1.0, 1.0));
    const Vec3 other = InTangentPlane(any, foot_normal_).normalized();
    if (other.allFinite() && TryHeading(other, length_mm)) return true;
  }
  return false;
}

bool SurfaceWalker::Walk(double length_mm) {
  const int steps = std::max(1, static_cast<int>(std::ceil(length_mm / (kStepVoxels * voxel_mm_))));
  for (int n = 0; n < steps; ++n) {
    if (!Step(length_mm / steps)) return false;
  }
  return true;
}

}  // namespace palpate::lab
