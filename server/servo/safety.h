// The last stage before the device: whatever was computed, the force on the
// hand is finite, within the device's limit, and changes gradually.
//
//   computed force -> finite? -> norm clamp -> slew limit -> device
//                       | no
//                       v
//                  zero at once, fault counted
//
// The slew limit also ramps forces in after a start and after a fault.
//
// Frame: D (N). Threads: one. Real-time: no allocation, no locks.
#pragma once

#include <cstdint>

#include "common/geometry/geometry.h"

namespace palpate {

struct SafetyLimits {
  double max_force_n = 3.3;
  // 0.2 N per ms: a stroke at 10 cm/s and 0.5 N/mm needs 0.05.
  double max_slew_n_per_s = 200.0;
};

class Safety {
 public:
  explicit Safety(const SafetyLimits& limits) : limits_(limits) {}

  // Force to write. dt_s: period of the loop.
  Vec3 Limit(const Vec3& force_D_n, double dt_s) noexcept;

  // Zero at once, for a device fault.
  Vec3 CutOff() noexcept {
    last_ = Vec3::Zero();
    return last_;
  }

  // What the next force is slewed from, and starts from again.
  const Vec3& last_D_n() const { return last_; }
  void Resume(const Vec3& last_D_n) noexcept { last_ = last_D_n; }

  // Forces that were not finite.
  std::uint64_t faults() const { return faults_; }

 private:
  SafetyLimits limits_;
  Vec3 last_ = Vec3::Zero();
  std::uint64_t faults_ = 0;
};

}  // namespace palpate
