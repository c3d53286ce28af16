// Names of the safety stage's values, for tables and the log.
#pragma once

#include <array>
#include <string_view>

#include "server/safety/safety.h"

namespace palpate {

constexpr std::string_view NameOf(ForceState state) {
  constexpr std::array<std::string_view, 6> kNames = {"off",  "ramp-in", "on",
                                                      "held", "fault",   "stopped"};
  return kNames[static_cast<std::size_t>(state)];
}

constexpr std::string_view NameOf(ForceReason reason) {
  constexpr std::array<std::string_view, 12> kNames = {
      "none",   "operator", "docked", "uncalibrated", "stale",     "deadlines",
      "device", "position", "force",  "speed",        "stop-call", "stop-button"};
  return kNames[static_cast<std::size_t>(reason)];
}

constexpr std::string_view NameOf(ForceCommand command) {
  constexpr std::array<std::string_view, 4> kNames = {"none", "enable", "disable", "stop"};
  return kNames[static_cast<std::size_t>(command)];
}

constexpr std::string_view NameOf(DeviceStatus status) {
  constexpr std::array<std::string_view, 3> kNames = {"ok", "stale", "fault"};
  return kNames[static_cast<std::size_t>(status)];
}

}  // namespace palpate
