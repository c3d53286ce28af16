// The settings of how a surface feels and what the stylus does to it. Users may change them while
// they touch.
//
// setting_list.h is generated from the contract's list (proto/palpate/v1/render.proto). It has
//   HapticSettings                    a member for each setting, with its default
//   kNumberSettings, kFlagSettings,
//   kChoiceSettings                   the same settings by name, with units, ranges and words
// Every effect and tool is off by default; only the stiffness is felt. The surface is H. The
// effects act at the proxy: friction holds it, static friction if that is greater than dynamic
// friction. The magnet pulls the stylus within magnet_range_mm, hardest half way. A pop takes the
// proxy through H to the other side. The carve tool works while kCarveButton is held, the clutch
// while kClutchButton is held.
//
// Units: in the names; forces and lengths are those of the device.
// Threads: plain values.
#pragma once

#include <cstdint>

#include "server/haptics/setting_kinds.h"
#include "server/haptics/setting_list.h"

namespace palpate {

// Bits of DeviceState::buttons.
inline constexpr std::uint32_t kCarveButton = 1u << 0;
inline constexpr std::uint32_t kClutchButton = 1u << 1;

}  // namespace palpate
