// A force, and the torque about a point that the holder names: N, N mm.
//
// N mm is mJ per rad, so energies of forces and torques add up without a factor.
#pragma once

#include "common/geometry/geometry.h"

namespace palpate {

struct Wrench {
  Vec3 force_n = Vec3::Zero();
  Vec3 torque_n_mm = Vec3::Zero();

  bool is_zero() const { return force_n.isZero() && torque_n_mm.isZero(); }
  bool allFinite() const { return force_n.allFinite() && torque_n_mm.allFinite(); }
};

}  // namespace palpate
