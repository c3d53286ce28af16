#include "common/wire/force_words.h"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace palpate {
namespace {

// Returns the rest of an enum's name, in small letters.
std::string After(std::string_view prefix, std::string name) {
  name.erase(0, std::min(prefix.size(), name.size()));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name.empty() ? "unknown" : name;
}

}  // namespace

std::string NameOf(v1::ForceState state) {
  return After("FORCE_STATE_", v1::ForceState_Name(state));
}

std::string NameOf(v1::ForceReason reason) {
  return After("FORCE_REASON_", v1::ForceReason_Name(reason));
}

std::string InWords(v1::ForceReason reason) {
  switch (reason) {
    case v1::FORCE_REASON_OPERATOR:
      return "not enabled: 'palpate device enable' lets them ramp in";
    case v1::FORCE_REASON_DOCKED:
      return "the stylus rests in its holder: take it out";
    case v1::FORCE_REASON_UNCALIBRATED:
      return "the stylus's position is not known yet: 'palpate device info' says what to do";
    case v1::FORCE_REASON_STALE:
      return "readings of the device are late: check its cable, and 'palpate device test'";
    case v1::FORCE_REASON_DEADLINES:
      return "the haptic loop misses ticks: see the warnings of 'palpate info'";
    case v1::FORCE_REASON_DEVICE:
      return "the device is gone or broken: check its cable and power, and 'palpate device info'";
    case v1::FORCE_REASON_POSITION:
      return "the device gave a position that is none: check it with 'palpate device test', then "
             "enable forces again";
    case v1::FORCE_REASON_FORCE:
      return "a force came out that is no number: change the settings or load the volume again, "
             "then enable forces again";
    case v1::FORCE_REASON_SPEED:
      return "the stylus was faster than a hand: hold it, then enable forces again";
    case v1::FORCE_REASON_STOP_CALL:
      return "emergency stop: 'palpate device enable' ends it";
    case v1::FORCE_REASON_STOP_BUTTON:
      return "emergency stop by the stylus's buttons: let them go, then 'palpate device enable'";
    case v1::FORCE_REASON_REPLAY:
      return "until the replay ends";
    default:
      return "";
  }
}

}  // namespace palpate
