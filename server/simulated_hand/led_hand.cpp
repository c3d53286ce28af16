#include "server/simulated_hand/led_hand.h"

#include <cmath>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr double kUnitLengthTolerance = 1e-3;

}  // namespace

LedHand::Lead LedHand::Take(const std::string& who) {
  const std::lock_guard lock(mutex_);
  if (is_taken_) {
    throw Error(ErrorKind::kConflict,
                "the hand is led by " + who_ + ": wait until they give it back");
  }
  is_taken_ = true;
  who_ = who;
  return ++newest_;
}

void LedHand::MoveTo(Lead lead, const Vec3& p_DTarget_mm, std::uint32_t buttons,
                     const std::optional<Eigen::Quaterniond>& R_DS) {
  if (!p_DTarget_mm.allFinite()) {
    throw Error(ErrorKind::kInvalidArgument, "a target of the hand needs three finite numbers");
  }
  Eigen::Quaterniond turned = R_DS.value_or(Eigen::Quaterniond::Identity());
  if (!(std::abs(turned.norm() - 1.0) < kUnitLengthTolerance)) {
    throw Error(ErrorKind::kInvalidArgument, "an orientation of the hand is a unit quaternion");
  }
  turned.normalize();
  const std::lock_guard lock(mutex_);
  if (!is_taken_ || lead != newest_) return;
  target_.Write({.is_led = true,
                 .x_mm = p_DTarget_mm.x(),
                 .y_mm = p_DTarget_mm.y(),
                 .z_mm = p_DTarget_mm.z(),
                 .buttons = buttons,
                 .is_turned = R_DS.has_value(),
                 .wxyz = {turned.w(), turned.x(), turned.y(), turned.z()}});
}

void LedHand::GiveBack(Lead lead) {
  const std::lock_guard lock(mutex_);
  if (!is_taken_ || lead != newest_) return;
  is_taken_ = false;
  target_.Write({});
}

std::string LedHand::led_by() const {
  const std::lock_guard lock(mutex_);
  return is_taken_ ? who_ : "";
}

}  // namespace palpate
