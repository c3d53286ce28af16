#include "server/lab/trajectory.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <random>

#include "common/error/error.h"
#include "server/lab/gbid.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {
namespace {

// A point that walks on the trilinear isosurface V, as a fingertip would.
//
// The point moves along the tangent with a slowly turning heading. It returns to V along the
// gradient, in steps that are small compared to a voxel. It turns round before it reaches the
// border. If V is too rough to walk on, the point stops; Restart() puts it elsewhere.
//
// Frame: W, the volume's world (mm). The same seed gives the same walk.
// Threads: one. Errors: Error (kInvalidArgument) if no place to start is found.
class SurfaceWalker {
 public:
  // Borrows the volume. `isovalue`: normalised. `lift_mm`: how far above V the space must be free
  // at the start.
  SurfaceWalker(const VolumeSnapshot& volume, double isovalue, double lift_mm, std::uint64_t seed);

  // Walks along V. False if the point is stuck.
  bool Walk(double length_mm);
  void Restart();

  const Vec3& p_mm() const { return p_mm_; }
  // Unit length, towards lower density; averaged over about a voxel of the walk.
  Vec3 normal() const { return normal_.normalized(); }

 private:
  struct Foot {
    bool found = false;
    Vec3 p_mm = Vec3::Zero();
    Vec3 normal = Vec3::Zero();
  };

  std::optional<Vec3> FindFromBorder();
  Foot FindFoot(Vec3 p_mm, double reach_mm) const;
  bool IsFreeAbove(const Foot& foot) const;
  bool IsInside(const Vec3& p_mm, const Vec3& margin_voxels) const;
  bool Step(double length_mm);
  bool TryHeading(const Vec3& heading, double length_mm);
  double Random(double low, double high);

  const VolumeSnapshot& volume_;
  const double isovalue_;
  const double lift_mm_;
  AffineMap X_WI_;
  AffineMap X_IW_;
  double voxel_mm_;
  Vec3 margin_voxels_ = Vec3::Zero();
  std::mt19937_64 random_;
  Vec3 p_mm_ = Vec3::Zero();
  Vec3 foot_normal_ = Vec3::UnitZ();
  Vec3 normal_ = Vec3::UnitZ();
  Vec3 heading_ = Vec3::UnitX();
  double walked_mm_ = 0.0;
};

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

constexpr double kTickS = 1e-3;
constexpr double kMmPerCm = 10.0;
constexpr double kLiftMm = 2.0;
constexpr int kApproachTicks = 300;

// Oscillates between -1 and 1.
double Wave(int tick, double period_s, double phase = 0.0) {
  return std::sin(2.0 * std::numbers::pi * (tick * kTickS / period_s + phase));
}

struct Motion {
  double speed_cm_per_s;
  double depth_mm;
};

Motion SlideMotion(const TrajectoryRequest& request, int tick) {
  return {request.speed_cm_per_s, 1.0 + 0.2 * Wave(tick, 0.7)};
}

// Below V for three quarters of the time.
Motion FreehandMotion(int tick) {
  return {12.0 + 7.0 * Wave(tick, 2.9), 0.7 + 0.9 * Wave(tick, 1.3, 0.25) + 0.2 * Wave(tick, 0.37)};
}

std::vector<Vec3> Walk(const VolumeSnapshot& volume, const TrajectoryRequest& request) {
  SurfaceWalker walker(volume, request.isovalue, kLiftMm, request.seed);
  std::vector<Vec3> hips_mm;
  int since_start = 0;
  for (int tick = 0; tick < request.ticks; ++tick) {
    const Motion motion =
        request.kind == TrajectoryKind::kSlide ? SlideMotion(request, tick) : FreehandMotion(tick);
    double depth_mm = motion.depth_mm;
    if (since_start < kApproachTicks) {
      const double share = static_cast<double>(since_start++) / kApproachTicks;
      depth_mm = share * depth_mm - (1.0 - share) * kLiftMm;
    } else if (!walker.Walk(motion.speed_cm_per_s * kMmPerCm * kTickS)) {
      walker.Restart();
      since_start = 0;
      depth_mm = -kLiftMm;
    }
    hips_mm.push_back(walker.p_mm() - depth_mm * walker.normal());
  }
  return hips_mm;
}

class Attack {
 public:
  Attack(const VolumeSnapshot& volume, std::uint64_t seed) : volume_(volume), random_(seed) {}

  Vec3 Next() {
    const double event = Uniform(0.0, 1.0);
    if (event < 0.002) return Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
    if (event < 0.003) return FarAway();
    if (event < 0.008) p_I_ = Anywhere();
    // Steps from a thousandth of a voxel to some voxels.
    const double size = std::pow(10.0, Uniform(-3.0, 0.7));
    p_I_ += size * Vec3(Uniform(-1.0, 1.0), Uniform(-1.0, 1.0), Uniform(-1.0, 1.0));
    return volume_.metadata().WorldFromIndex().Apply(p_I_);
  }

 private:
  double Uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_() >> 11) * 0x1p-53);
  }

  // In the volume or next to it.
  Vec3 Anywhere() {
    const Vec3 size = volume_.size().cast<double>();
    Vec3 p_I;
    for (int axis = 0; axis < 3; ++axis) p_I[axis] = size[axis] * Uniform(-0.1, 1.1);
    return p_I;
  }

  Vec3 FarAway() { return 1e5 * Vec3(Uniform(-1.0, 1.0), Uniform(-1.0, 1.0), Uniform(-1.0, 1.0)); }

  const VolumeSnapshot& volume_;
  std::mt19937_64 random_;
  Vec3 p_I_ = Vec3::Constant(-2.0);
};

}  // namespace

std::optional<TrajectoryKind> TrajectoryNamed(std::string_view name) {
  for (std::size_t n = 0; n < kTrajectoryNames.size(); ++n) {
    if (kTrajectoryNames[n] == name) return static_cast<TrajectoryKind>(n);
  }
  return std::nullopt;
}

std::vector<Vec3> MakeTrajectory(const VolumeSnapshot& volume, const TrajectoryRequest& request) {
  if (request.ticks < 1 || !(request.speed_cm_per_s >= 0.0 && request.speed_cm_per_s <= 1000.0)) {
    throw Error(ErrorKind::kInvalidArgument,
                "give at least one tick and a speed from 0 to 1000 cm/s");
  }
  if (request.kind != TrajectoryKind::kRandom) return Walk(volume, request);
  Attack attack(volume, request.seed);
  std::vector<Vec3> hips_mm;
  for (int tick = 0; tick < request.ticks; ++tick) hips_mm.push_back(attack.Next());
  return hips_mm;
}

}  // namespace palpate::lab
