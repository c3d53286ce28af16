// What random attacks on the proxy have in common: the volumes, how the HIP moves, and how a
// resting proxy is judged.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "server/lab/proxy_judges.h"
#include "tests/support/made_volume.h"
#include "tests/support/path_judge.h"

namespace palpate::testing {

inline constexpr double kDensityTolerance = 1e-9;
// What a resting proxy may still come nearer, as a share of its distance and in voxels.
inline constexpr double kApproachShare = 1e-12;
inline constexpr double kApproachVoxels = 2e-11;
// Farther away than this, in barycentric weights, a tetrahedron does not touch the proxy. The proxy
// lies exactly on what is nearer than 5e-12, since the steps between ties make pits as small.
// Positions are rounded to less.
inline constexpr double kTouchTolerance = 3e-12;

// Random values on 5³ lattices of `levels` values; 0: continuous; 1: a tenth of the voxels in free
// space. Some are level sets: all around them is material.
inline std::shared_ptr<const VolumeSnapshot> RandomVolume(std::mt19937_64& random, int levels) {
  std::uniform_real_distribution<double> uniform;
  const auto volume = MakeVolume(Vec3i::Constant(5), [&](int, int, int) {
    if (levels == 1) return uniform(random) < 0.1 ? 1.0 : 0.2 * uniform(random);
    return levels == 0 ? uniform(random) : std::floor(uniform(random) * levels);
  });
  VolumeMetadata metadata = volume->metadata();
  metadata.is_level_set = uniform(random) < 0.2;
  return std::make_shared<VolumeSnapshot>(metadata, volume->bricks(), 1, 1);
}

inline bool HasRange(const VolumeSnapshot& volume) {
  return volume.metadata().value_max > volume.metadata().value_min;
}

// `middle`: of the values among which τ is chosen.
inline HapticSurface RandomSurface(std::mt19937_64& random, const VolumeSnapshot& volume,
                                   int refinement, const Vec3i& middle = Vec3i::Ones()) {
  std::uniform_real_distribution<double> uniform;
  Mat3 shear = Mat3::Identity();
  if (uniform(random) < 0.5) {
    shear << 1.0, 0.3, 0.0, 0.0, -0.7, 0.1, 0.2, 0.0, 1.4;  // mirrored, sheared, uneven
  }
  const double mm = std::pow(10.0, 3.0 * uniform(random) - 2.0);
  double isovalue = uniform(random);
  // Equal to a value that is there, the least and the greatest included.
  if (uniform(random) < 0.4) {
    isovalue = volume.StoredCell(middle)[static_cast<std::size_t>(uniform(random) * 8)];
  }
  if (uniform(random) < 0.1) isovalue = uniform(random) < 0.5 ? 0.0 : 1.0;
  // Only 2 kTieStep above it is the padding of a level set: H between them is known to 1e-8 voxels.
  if (volume.metadata().is_level_set && isovalue == 1.0) isovalue = 0.75;
  const FreeSide side = uniform(random) < 0.7 ? FreeSide::kBelow : FreeSide::kAbove;
  return MakeHapticSurface(volume, {shear * mm, Vec3(3.0, -7.0, 11.0)}, isovalue,
                           DecompositionMethod::kTpbcc, 1, side, refinement);
}

// A HIP that drifts, jitters, teleports, and sits on lattice points.
inline void MoveHip(std::mt19937_64& random, Vec3& hip_I) {
  std::uniform_real_distribution<double> uniform;
  const double kind = uniform(random);
  const Vec3 r(uniform(random), uniform(random), uniform(random));
  if (kind < 0.02) {
    hip_I = 10.0 * r - Vec3::Constant(3.0);
  } else if (kind < 0.05) {
    hip_I = hip_I.array().round();
  } else {
    hip_I += (kind < 0.5 ? 0.05 : 0.6) * (r - Vec3::Constant(0.5));
    hip_I = hip_I.cwiseMax(-2.0).cwiseMin(6.0);
  }
}

// How much nearer to the HIP a resting proxy could be, in voxels; 0 where it is rounding.
inline double ApproachLeft(PathJudge& judge, const Vec3& p_DH_mm, const Vec3& hip_mm) {
  // The longest edge, by which the proxy's rounding is measured.
  const double voxel_mm = judge.cells().surface().longest_voxel_mm;
  const double way_mm = (hip_mm - p_DH_mm).norm();
  const double tolerance_mm = std::max(kApproachShare * way_mm, kApproachVoxels * voxel_mm);
  if (way_mm <= tolerance_mm) return 0.0;
  const double left_mm = lab::ApproachLeft(judge.cells(), p_DH_mm, hip_mm, kTouchTolerance);
  return left_mm <= tolerance_mm ? 0.0 : left_mm / voxel_mm;
}

}  // namespace palpate::testing
