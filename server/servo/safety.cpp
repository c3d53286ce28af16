#include "server/servo/safety.h"

namespace palpate {
namespace {

// Shortened to `length` where it is longer. Scaled first: the norm of a huge
// vector would overflow.
Vec3 Clamp(const Vec3& v, double length) {
  const double scale = v.cwiseAbs().maxCoeff();
  if (!(scale > 0.0)) return Vec3::Zero();
  const Vec3 unit = v / scale;
  const double norm = unit.norm();
  return norm * scale > length ? Vec3(unit * (length / norm)) : v;
}

}  // namespace

Vec3 Safety::Limit(const Vec3& force_D_n, double dt_s) noexcept {
  if (!force_D_n.allFinite()) {
    ++faults_;
    return CutOff();
  }
  const Vec3 wanted = Clamp(force_D_n, limits_.max_force_n);
  last_ += Clamp(wanted - last_, limits_.max_slew_n_per_s * dt_s);
  return last_;
}

}  // namespace palpate
