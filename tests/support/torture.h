// What random attacks on the proxy have in common: how the HIP moves, and how a resting proxy is
// judged.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>

#include "server/lab/rest_judge.h"
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
