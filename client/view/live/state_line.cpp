#include "client/view/live/state_line.h"

#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace palpate::view {
namespace {

using client::ConnectionState;
using client::ForceReason;
using client::ForceState;

// Says why forces are not on; empty if the state says it already.
const char* InWords(ForceReason reason) {
  switch (reason) {
    case ForceReason::kUnknown:
    case ForceReason::kNone:
      return "";
    case ForceReason::kOperator:
      return "not enabled";
    case ForceReason::kDocked:
      return "the stylus is docked: take it out";
    case ForceReason::kUncalibrated:
      return "the device is not calibrated";
    case ForceReason::kStale:
      return "readings come late";
    case ForceReason::kDeadlines:
      return "the loop misses deadlines";
    case ForceReason::kDevice:
      return "the device is gone or broken";
    case ForceReason::kPosition:
      return "a position was no number";
    case ForceReason::kForce:
      return "a force was no number";
    case ForceReason::kSpeed:
      return "the stylus moved too fast";
    case ForceReason::kStopCall:
      return "emergency stop";
    case ForceReason::kStopButton:
      return "emergency stop by the stylus";
    case ForceReason::kReplay:
      return "until the replay ends";
  }
  return "";
}

std::string With(const std::string& state, const std::string& why) {
  return why.empty() ? state : state + ": " + why;
}

StateLine OfForces(const client::ForceStatus& forces, const KnownState& known) {
  const std::string why = forces.reason == ForceReason::kDevice && !known.device_problem.empty()
                              ? known.device_problem
                              : InWords(forces.reason);
  switch (forces.state) {
    case ForceState::kUnknown:
      return {Tone::kCaution, "forces unknown"};
    case ForceState::kOff:
      return {Tone::kIdle, With("forces off", why), ForceAction::kEnable};
    case ForceState::kRampIn:
      return {Tone::kActing, "forces are coming on", ForceAction::kDisable};
    case ForceState::kOn:
      if (known.mode == client::ProxyMode::kSuspended) {
        return {Tone::kIdle, "nothing is felt: the volume is moved", ForceAction::kDisable};
      }
      if (known.mode == client::ProxyMode::kInside) {
        return {Tone::kCaution, "nothing is felt: the stylus is inside the surface, pull it out",
                ForceAction::kDisable};
      }
      return {Tone::kActing, "forces on", ForceAction::kDisable};
    case ForceState::kHeld:
      return {Tone::kCaution, With("forces held back", why), ForceAction::kDisable};
    case ForceState::kFault:
      return {Tone::kAlarm, With("forces off after a fault", why), ForceAction::kEnable};
    case ForceState::kStopped:
      return {Tone::kAlarm, With("forces stopped", why), ForceAction::kEnable};
  }
  return {Tone::kCaution, "forces unknown"};
}

// What the forces do after the replay.
StateLine OfReplay(const client::ForceStatus& forces, const KnownState& known) {
  StateLine line = OfForces(forces, known);
  line.text = known.replay + (forces.reason == ForceReason::kReplay
                                  ? " " + std::string(InWords(forces.reason))
                                  : "; " + line.text);
  if (line.tone != Tone::kAlarm) line.tone = Tone::kCaution;
  return line;
}

}  // namespace

StateLine StateOf(const KnownState& known) {
  if (known.disconnected) return {Tone::kIdle, "not connected"};
  switch (known.connection) {
    case ConnectionState::kConnecting:
      return {Tone::kCaution, "connecting: forces unknown"};
    case ConnectionState::kLost:
      return {Tone::kAlarm, "connection lost: forces unknown"};
    case ConnectionState::kConnected:
      break;
  }
  if (known.silent_s) {
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, "%.1f", *known.silent_s);
    return {Tone::kAlarm,
            std::string("palpated sends nothing for ") + seconds + " s: forces unknown"};
  }
  if (!known.forces) return {Tone::kCaution, "no pose yet: forces unknown"};
  return known.replay.empty() ? OfForces(*known.forces, known) : OfReplay(*known.forces, known);
}

std::optional<double> FractionIn(const std::string& line) {
  const std::size_t comma = line.rfind(", ");
  if (comma == std::string::npos || !line.ends_with(" %")) return std::nullopt;
  char* end = nullptr;
  const char* number = line.c_str() + comma + 2;
  const double percent = std::strtod(number, &end);
  if (end == number || std::string_view(end) != " %" || !(percent >= 0.0 && percent <= 100.0)) {
    return std::nullopt;
  }
  return 0.01 * percent;
}

}  // namespace palpate::view
