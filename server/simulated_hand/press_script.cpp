#include "server/simulated_hand/press_script.h"

#include <cmath>
#include <utility>

#include "common/error/error.h"

namespace palpate {

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
