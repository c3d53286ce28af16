#include "server/simulated_hand/fixed_scripts.h"

#include <cmath>
#include <utility>

#include "common/error/error.h"

namespace palpate {

PathScript::PathScript(std::vector<Vec3> p_MWaypoints_mm, double speed_mm_s)
    : waypoints_mm_(std::move(p_MWaypoints_mm)), speed_mm_s_(speed_mm_s) {
  bool valid = !waypoints_mm_.empty() && std::isfinite(speed_mm_s) && speed_mm_s > 0.0;
  for (const Vec3& waypoint : waypoints_mm_) valid = valid && waypoint.allFinite();
  if (!valid) {
    throw Error(ErrorKind::kInvalidArgument,
                "a stylus path needs finite way points, one at least, and a speed above 0 mm/s");
  }
  target_mm_ = waypoints_mm_.front();
}

StylusScript::Target PathScript::Next(const HandState& /*hand*/, const Wrench& /*felt_M*/,
                                      double dt_s) noexcept {
  double left_mm = speed_mm_s_ * dt_s;
  // At most one round per call: otherwise a path of length zero would never end.
  for (std::size_t i = 0; i < waypoints_mm_.size() && left_mm > 0.0; ++i) {
    const Vec3 ahead_mm = waypoints_mm_[next_] - target_mm_;
    const double distance_mm = ahead_mm.norm();
    if (distance_mm > left_mm) {
      target_mm_ += ahead_mm * (left_mm / distance_mm);
      break;
    }
    target_mm_ = waypoints_mm_[next_];
    left_mm -= distance_mm;
    next_ = (next_ + 1) % waypoints_mm_.size();
  }
  return {.p_MTarget_mm = target_mm_, .buttons = 0};
}

PressScript::PressScript(std::unique_ptr<StylusScript> script, std::uint32_t buttons)
    : script_(std::move(script)), buttons_(buttons) {
  if (script_ == nullptr) {
    throw Error(ErrorKind::kInvalidArgument,
                "a press script needs another script that moves the hand");
  }
}

StylusScript::Target PressScript::Next(const HandState& hand, const Wrench& felt_M,
                                       double dt_s) noexcept {
  Target target = script_->Next(hand, felt_M, dt_s);
  time_s_ = std::fmod(time_s_ + dt_s, kPressPeriodS);
  if (time_s_ >= kPressPeriodS - kPressedS) target.buttons |= buttons_;
  return target;
}

}  // namespace palpate
