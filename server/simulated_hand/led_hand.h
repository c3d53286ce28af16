// The simulated hand while a person leads it: who does, and where they want it.
//
// One leader at a time. A leader takes the hand, moves it, and gives it back. The servo thread sees
// the newest target only.
//
// Frame D, mm. Threads: Newest on the servo thread; everything else on any ordinary thread.
// Real-time: Newest is wait-free. Ownership: outlives the device that follows it.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "common/geometry/geometry.h"
#include "server/realtime/latest_value.h"

namespace palpate {

struct LedTarget {
  bool is_led = false;  // false: nobody leads the hand, and the rest means nothing
  double x_mm = 0.0;    // finite
  double y_mm = 0.0;
  double z_mm = 0.0;
  std::uint32_t buttons = 0;  // bit n: button n pressed
  // How the stylus is to be turned: a unit quaternion. `is_turned` is false: as it turns by itself.
  bool is_turned = false;
  std::array<double, 4> wxyz{1.0, 0.0, 0.0, 0.0};
};

class LedHand {
 public:
  // A leader's number, never 0.
  using Lead = std::uint64_t;

  // `who`: for people, such as "token ada at ipv4:192.0.2.7:51544". Throws Error (kConflict) that
  // names who leads the hand already. The hand moves with the first MoveTo.
  Lead Take(const std::string& who);
  // Ignored after GiveBack. Throws Error (kInvalidArgument) if the target is not finite, or the
  // orientation no unit quaternion but for rounding. No orientation: as the stylus turns by itself.
  void MoveTo(Lead lead, const Vec3& p_DTarget_mm, std::uint32_t buttons,
              const std::optional<Eigen::Quaterniond>& R_DS = {});
  // May be called again.
  void GiveBack(Lead lead);

  // Who leads the hand; empty: nobody.
  std::string led_by() const;

  const LedTarget& Newest() noexcept { return target_.Read(); }

 private:
  mutable std::mutex mutex_;  // guards the next three, and is the target's one writer
  Lead newest_ = 0;
  bool is_taken_ = false;
  std::string who_;
  LatestValue<LedTarget> target_;
};

}  // namespace palpate
