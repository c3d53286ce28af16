#include "client/view/palpated/state_line.h"

#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace palpate::view {
namespace {

using client::ConnectionState;
using client::ForceReason;
using client::ForceState;
using client::ProxyMode;

std::string With(const std::string& state, const std::string& why) {
  return why.empty() ? state : state + ": " + why;
}

StateLine OfForces(const client::ForceStatus& forces, const KnownState& known) {
  const std::string why = forces.reason == ForceReason::kDevice && !known.device_problem.empty()
                              ? known.device_problem
                              : std::string(Describe(forces.reason).says);
  const std::string says(Describe(forces.state).says);
  switch (forces.state) {
    case ForceState::kUnknown:
      break;
    case ForceState::kOff:
      return {Tone::kIdle, With(says, why), ForceAction::kEnable};
    case ForceState::kOn:
      if (known.mode == ProxyMode::kSuspended || known.mode == ProxyMode::kInside) {
        const bool is_moved = known.mode == ProxyMode::kSuspended;
        return {is_moved ? Tone::kIdle : Tone::kCaution, std::string(Describe(known.mode).says),
                ForceAction::kDisable};
      }
      return {Tone::kActing, says, ForceAction::kDisable};
    case ForceState::kRampIn:
      return {Tone::kActing, says, ForceAction::kDisable};
    case ForceState::kHeld:
      return {Tone::kCaution, With(says, why), ForceAction::kDisable};
    case ForceState::kFault:
    case ForceState::kStopped:
      return {Tone::kAlarm, With(says, why), ForceAction::kEnable};
  }
  return {Tone::kCaution, says};
}

// What the forces do after the replay.
StateLine OfReplay(const client::ForceStatus& forces, const KnownState& known) {
  StateLine line = OfForces(forces, known);
  line.text = known.replay + (forces.reason == ForceReason::kReplay
                                  ? " " + std::string(Describe(forces.reason).says)
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
