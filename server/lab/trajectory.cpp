#include "server/lab/trajectory.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "common/error/error.h"
#include "server/lab/surface_walker.h"

namespace palpate::lab {
namespace {

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
