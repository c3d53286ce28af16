// How a surface feels and what the stylus does to it: what users set while they
// touch.
//
// Every effect and tool is off by default; stiffness alone is felt then.
// Units: in the names; forces and lengths are those of the device.
// Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace palpate {

// The side of H on which the proxy is free: where densities are below τ, or
// above it, to feel a cavity from the inside.
enum class FreeSide : std::uint8_t { kBelow, kAbove };

struct HapticSettings {
  double stiffness_n_per_mm = 0.5;
  // Against motion along the surface's normal, in contact.
  double damping_n_s_per_m = 0.0;
  // Coulomb friction of the proxy on H: tangential per normal force. The static
  // one holds where it is the greater.
  double static_friction = 0.0;
  double dynamic_friction = 0.0;
  // Drag against all motion of the stylus, in contact and out of it.
  double viscosity_n_s_per_m = 0.0;
  // Spring force at which the proxy pops through H to its other side; 0: never.
  double pop_force_n = 0.0;
  // Pull towards H from a distance below magnet_range_mm; greatest half way.
  double magnet_force_n = 0.0;
  double magnet_range_mm = 2.0;
  // Of the carve tool; the rate is a share of the range of values per second, and
  // a negative one adds.
  double carve_radius_mm = 2.0;
  double carve_rate_per_s = 2.0;
  // Force along a normal that varies smoothly over H.
  bool force_shading = false;
  // Keeps the rendered surface from giving off more energy than it took in.
  bool passivity_control = false;
  // Tools, which work while a button of the stylus is held: kCarveButton takes the
  // volume away around the proxy, kClutchButton moves it with the stylus.
  bool carve_tool = false;
  bool clutch_tool = false;
  FreeSide free_side = FreeSide::kBelow;
};

// Bits of DeviceState::buttons.
inline constexpr std::uint32_t kCarveButton = 1u << 0;
inline constexpr std::uint32_t kClutchButton = 1u << 1;

// Settings by the names that configuration files, clients and command lines use.
struct NumberSetting {
  std::string_view key;
  double HapticSettings::*member;
  double low, high;
  std::string_view unit;  // with a leading blank; empty: a ratio
};
inline constexpr std::array<NumberSetting, 10> kNumberSettings = {{
    {"stiffness_n_per_mm", &HapticSettings::stiffness_n_per_mm, 0.0, 3.0, " N/mm"},
    {"damping_n_s_per_m", &HapticSettings::damping_n_s_per_m, 0.0, 5.0, " N·s/m"},
    {"static_friction", &HapticSettings::static_friction, 0.0, 2.0, ""},
    {"dynamic_friction", &HapticSettings::dynamic_friction, 0.0, 2.0, ""},
    {"viscosity_n_s_per_m", &HapticSettings::viscosity_n_s_per_m, 0.0, 5.0, " N·s/m"},
    {"pop_force_n", &HapticSettings::pop_force_n, 0.0, 3.3, " N"},
    {"magnet_force_n", &HapticSettings::magnet_force_n, 0.0, 1.5, " N"},
    {"magnet_range_mm", &HapticSettings::magnet_range_mm, 0.0, 10.0, " mm"},
    {"carve_radius_mm", &HapticSettings::carve_radius_mm, 0.1, 20.0, " mm"},
    {"carve_rate_per_s", &HapticSettings::carve_rate_per_s, -20.0, 20.0, " 1/s"},
}};

struct FlagSetting {
  std::string_view key;
  bool HapticSettings::*member;
};
inline constexpr std::array<FlagSetting, 4> kFlagSettings = {{
    {"force_shading", &HapticSettings::force_shading},
    {"passivity_control", &HapticSettings::passivity_control},
    {"carve_tool", &HapticSettings::carve_tool},
    {"clutch_tool", &HapticSettings::clutch_tool},
}};

inline constexpr std::array<std::string_view, 2> kFreeSideNames = {"below", "above"};
constexpr std::string_view FreeSideName(FreeSide side) {
  return kFreeSideNames[static_cast<std::size_t>(side)];
}
constexpr std::optional<FreeSide> FreeSideNamed(std::string_view name) {
  for (std::size_t n = 0; n < kFreeSideNames.size(); ++n) {
    if (kFreeSideNames[n] == name) return static_cast<FreeSide>(n);
  }
  return std::nullopt;
}

}  // namespace palpate
