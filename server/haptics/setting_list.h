// Written by proto/generate from palpate/v1/render.proto: change that.
#pragma once

#include <array>

#include "common/contract/render.h"
#include "server/haptics/setting_kinds.h"

namespace palpate {

struct HapticSettings {
  // force per device motion into the surface: 0 to 3 N/mm
  double stiffness_n_per_mm = 0.5;
  // damping of motion along the surface's normal, in contact: 0 to 5 N·s/m
  double damping_n_s_per_m = 0.0;
  // friction at rest, tangential per normal force; no effect below dynamic_friction: 0 to 2
  double static_friction = 0.0;
  // friction while sliding, tangential per normal force: 0 to 2
  double dynamic_friction = 0.0;
  // greatest force of a grain on the surface, at most half the force into it; 0: smooth: 0 to 1 N
  double texture_force_n = 0.0;
  // way along the surface from one grain to the next, on the device: 0.3 to 20 mm
  double texture_wavelength_mm = 1.0;
  // radius of a ball at the stylus's tip, on the device; 0: a point; else 0.3 to 8 voxels of the shortest edge: 0 to 20 mm
  double tool_radius_mm = 0.0;
  // drag on all motion of the stylus, in contact and out of it: 0 to 5 N·s/m
  double viscosity_n_s_per_m = 0.0;
  // spring force at which the stylus pops through the surface; that force then fades within 30 ms; 0: never: 0 to 3.3 N
  double pop_force_n = 0.0;
  // greatest pull of the surface on a stylus near it; 0: none: 0 to 1.5 N
  double magnet_force_n = 0.0;
  // distance up to which the surface pulls: 0 to 10 mm
  double magnet_range_mm = 2.0;
  // radius of the sphere that the stylus carves, on the device: 0.1 to 20 mm
  double carve_radius_mm = 2.0;
  // share of the range of values that carving takes away per second; negative: adds: -20 to 20 1/s
  double carve_rate_per_s = 2.0;
  // parts that each edge of a voxel is cut into for the felt surface: 1, 2, 3 or 4
  double refinement = 2.0;
  // force along a normal that varies smoothly over the surface: on or off
  bool force_shading = false;
  // the surface gives off no more energy than it took in: on or off
  bool passivity_control = false;
  // the stylus carves around the proxy while its button 0 is held: on or off
  bool carve_tool = false;
  // the stylus moves the volume, forces off, while its button 1 is held: on or off
  bool clutch_tool = false;
  // side of the isovalue on which the stylus is free: below or above
  FreeSide free_side = FreeSide::kBelow;
  // how cells are cut into tetrahedra: bcc or tpbcc
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  // By ascending isovalue; none: the one surface of the settings above
  SurfaceLayers layers{};
  // Without balls: the tip is felt
  HeldTool tool{};
};

inline constexpr std::array<NumberSetting, 14> kNumberSettings = {{
    {"stiffness_n_per_mm", &HapticSettings::stiffness_n_per_mm, 0.0, 3.0, " N/mm", false, false, true},
    {"damping_n_s_per_m", &HapticSettings::damping_n_s_per_m, 0.0, 5.0, " N·s/m", false, false, true},
    {"static_friction", &HapticSettings::static_friction, 0.0, 2.0, "", false, true, true},
    {"dynamic_friction", &HapticSettings::dynamic_friction, 0.0, 2.0, "", false, true, true},
    {"texture_force_n", &HapticSettings::texture_force_n, 0.0, 1.0, " N", false, true, false},
    {"texture_wavelength_mm", &HapticSettings::texture_wavelength_mm, 0.3, 20.0, " mm", false, false, false},
    {"tool_radius_mm", &HapticSettings::tool_radius_mm, 0.0, 20.0, " mm", false, false, false},
    {"viscosity_n_s_per_m", &HapticSettings::viscosity_n_s_per_m, 0.0, 5.0, " N·s/m", false, false, false},
    {"pop_force_n", &HapticSettings::pop_force_n, 0.0, 3.3, " N", false, true, true},
    {"magnet_force_n", &HapticSettings::magnet_force_n, 0.0, 1.5, " N", false, true, false},
    {"magnet_range_mm", &HapticSettings::magnet_range_mm, 0.0, 10.0, " mm", false, false, false},
    {"carve_radius_mm", &HapticSettings::carve_radius_mm, 0.1, 20.0, " mm", false, false, false},
    {"carve_rate_per_s", &HapticSettings::carve_rate_per_s, -20.0, 20.0, " 1/s", false, false, false},
    {"refinement", &HapticSettings::refinement, 1.0, 4.0, "", true, false, false},
}};

inline constexpr std::array<FlagSetting, 4> kFlagSettings = {{
    {"force_shading", &HapticSettings::force_shading, true},
    {"passivity_control", &HapticSettings::passivity_control, false},
    {"carve_tool", &HapticSettings::carve_tool, false},
    {"clutch_tool", &HapticSettings::clutch_tool, false},
}};

inline constexpr std::array<ChoiceSetting, 2> kChoiceSettings = {{
    MakeChoice<&HapticSettings::free_side>("free_side"),
    MakeChoice<&HapticSettings::method>("method"),
}};

}  // namespace palpate
