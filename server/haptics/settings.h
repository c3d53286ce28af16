// How a surface feels and what the stylus does to it: what users set while they
// touch.
//
// setting_list.h is written from the contract's list (proto/palpate/v1/render.proto). It has
//   HapticSettings                  a member for each setting, with its default
//   kNumberSettings, kFlagSettings  the same by their names, with units and ranges
// Every effect and tool is off by default; stiffness alone is felt then. Surfaces are H, and the
// stylus is felt at the proxy: static friction holds it while it is the greater of the two, the
// magnet pulls it from magnet_range_mm on, hardest half way, and a pop takes it through H to the
// other side. The carve tool works while kCarveButton is held, the clutch while kClutchButton is.
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
