#include "server/device/led_hand.h"

#include "common/error/error.h"

namespace palpate {

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

void LedHand::MoveTo(Lead lead, const Vec3& p_DTarget_mm, std::uint32_t buttons) {
  if (!p_DTarget_mm.allFinite()) {
    throw Error(ErrorKind::kInvalidArgument, "a target of the hand needs three finite numbers");
  }
  const std::lock_guard lock(mutex_);
  if (!is_taken_ || lead != newest_) return;
  target_.Write({.is_led = true,
                 .x_mm = p_DTarget_mm.x(),
                 .y_mm = p_DTarget_mm.y(),
                 .z_mm = p_DTarget_mm.z(),
                 .buttons = buttons});
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
