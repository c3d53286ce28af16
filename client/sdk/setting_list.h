// Written by proto/generate from palpate/v1/render.proto: change that.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>

#include "client/sdk/setting.h"
#include "common/contract/render.h"

namespace palpate::client {

struct Settings {
  // which surface is felt, in data units (HU, intensity), within the volume's range: a number
  double isovalue = 0.0;
  // the same over the volume's range at load; also: isovalue --normalized: 0 to 1
  double normalized_isovalue = 0.5;
  // force per device motion into the surface: 0 to 3 N/mm
  double stiffness_n_per_mm = 0.5;
  // damping of motion along the surface's normal, in contact: 0 to 5 N·s/m
  double damping_n_s_per_m = 0.0;
  // how cells are cut into tetrahedra: bcc or tpbcc
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  // friction at rest, tangential per normal force; no effect below dynamic_friction: 0 to 2
  double static_friction = 0.0;
  // friction while sliding, tangential per normal force: 0 to 2
  double dynamic_friction = 0.0;
  // drag on all motion of the stylus, in contact and out of it: 0 to 5 N·s/m
  double viscosity_n_s_per_m = 0.0;
  // spring force at which the stylus pops through the surface; that force then fades within 30 ms; 0: never: 0 to 3.3 N
  double pop_force_n = 0.0;
  // greatest pull of the surface on a stylus near it; 0: none: 0 to 1.5 N
  double magnet_force_n = 0.0;
  // distance up to which the surface pulls: 0 to 10 mm
  double magnet_range_mm = 2.0;
  // force along a normal that varies smoothly over the surface: on or off
  bool force_shading = false;
  // the surface gives off no more energy than it took in: on or off
  bool passivity_control = false;
  // side of the isovalue on which the stylus is free: below or above
  FreeSide free_side = FreeSide::kBelow;
  // the stylus carves around the proxy while its button 0 is held: on or off
  bool carve_tool = false;
  // radius of the sphere that the stylus carves, on the device: 0.1 to 20 mm
  double carve_radius_mm = 2.0;
  // share of the range of values that carving takes away per second; negative: adds: -20 to 20 1/s
  double carve_rate_per_s = 2.0;
  // the stylus moves the volume, forces off, while its button 1 is held: on or off
  bool clutch_tool = false;
  // parts that each edge of a voxel is cut into for the felt surface: 1, 2, 3 or 4
  double refinement = 2.0;
  // greatest force of a grain on the surface, at most half the force into it; 0: smooth: 0 to 1 N
  double texture_force_n = 0.0;
  // way along the surface from one grain to the next, on the device: 0.3 to 20 mm
  double texture_wavelength_mm = 1.0;
  // radius of a ball at the stylus's tip, on the device; 0: a point; else 0.3 to 8 voxels of the shortest edge: 0 to 20 mm
  double tool_radius_mm = 0.0;

  // Rises with every change of settings, of where the volume lies, and with every
  // volume that is loaded; begins anew with every start of the daemon.
  std::uint64_t revision = 0;
  // Bit n: the daemon has no kSettings[n], or a value of it that this library does not know.
  // The member has the default then.
  std::bitset<22> unknown;
  // Felt in place of the one surface, by ascending isovalue; none: the one surface.
  SurfaceLayers layers{};
  HeldTool tool{};   // felt in place of the tip; without balls: none
  BallState ball{};  // what is felt of tool_radius_mm, or of the tool
  // A recording is replayed, and all this is recorded.
  bool replayed = false;
};

// What is to change, all at one tick; what is absent stays. Of isovalue and normalized_isovalue
// at most one.
struct SettingsUpdate {
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  std::optional<double> stiffness_n_per_mm{};
  std::optional<double> damping_n_s_per_m{};
  std::optional<DecompositionMethod> method{};
  std::optional<double> static_friction{};
  std::optional<double> dynamic_friction{};
  std::optional<double> viscosity_n_s_per_m{};
  std::optional<double> pop_force_n{};
  std::optional<double> magnet_force_n{};
  std::optional<double> magnet_range_mm{};
  std::optional<bool> force_shading{};
  std::optional<bool> passivity_control{};
  std::optional<FreeSide> free_side{};
  std::optional<bool> carve_tool{};
  std::optional<double> carve_radius_mm{};
  std::optional<double> carve_rate_per_s{};
  std::optional<bool> clutch_tool{};
  std::optional<double> refinement{};
  std::optional<double> texture_force_n{};
  std::optional<double> texture_wavelength_mm{};
  std::optional<double> tool_radius_mm{};

  std::optional<SurfaceLayers> layers{};  // all of them
  std::optional<HeldTool> tool{};         // all of it
  // Refuse with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

// All, in the order in which they are shown; the isovalue's two come first.
inline constexpr std::array<Setting, 22> kSettings = {{
    {"isovalue", "isovalue", "Isovalue", "",
     "which surface is felt, in data units (HU, intensity), within the volume's range",
     "", false, false, true,
     NumberSetting{&Settings::isovalue, &SettingsUpdate::isovalue, -std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), 0.0, false}},
    {"normalized_isovalue", "normalized_isovalue", "Isovalue, normalised", "",
     "the same over the volume's range at load; also: isovalue --normalized",
     "", false, false, true,
     NumberSetting{&Settings::normalized_isovalue, &SettingsUpdate::normalized_isovalue, 0.0, 1.0, 0.5, false}},
    {"stiffness_n_per_mm", "stiffness", "Stiffness", "N/mm",
     "force per device motion into the surface",
     "", false, false, true,
     NumberSetting{&Settings::stiffness_n_per_mm, &SettingsUpdate::stiffness_n_per_mm, 0.0, 3.0, 0.5, false}},
    {"damping_n_s_per_m", "damping", "Damping", "N·s/m",
     "damping of motion along the surface's normal, in contact",
     "", false, false, true,
     NumberSetting{&Settings::damping_n_s_per_m, &SettingsUpdate::damping_n_s_per_m, 0.0, 5.0, 0.0, false}},
    {"static_friction", "static_friction", "Static friction", "",
     "friction at rest, tangential per normal force; no effect below dynamic_friction",
     "", true, false, true,
     NumberSetting{&Settings::static_friction, &SettingsUpdate::static_friction, 0.0, 2.0, 0.0, false}},
    {"dynamic_friction", "dynamic_friction", "Sliding friction", "",
     "friction while sliding, tangential per normal force",
     "", true, false, true,
     NumberSetting{&Settings::dynamic_friction, &SettingsUpdate::dynamic_friction, 0.0, 2.0, 0.0, false}},
    {"texture_force_n", "texture_force", "Grain", "N",
     "greatest force of a grain on the surface, at most half the force into it; 0: smooth",
     "", true, false, false,
     NumberSetting{&Settings::texture_force_n, &SettingsUpdate::texture_force_n, 0.0, 1.0, 0.0, false}},
    {"texture_wavelength_mm", "texture_wavelength", "Grain's wavelength", "mm",
     "way along the surface from one grain to the next, on the device",
     "texture_force_n", false, false, false,
     NumberSetting{&Settings::texture_wavelength_mm, &SettingsUpdate::texture_wavelength_mm, 0.3, 20.0, 1.0, false}},
    {"tool_radius_mm", "tool_radius", "Ball at the tip", "mm",
     "radius of a ball at the stylus's tip, on the device; 0: a point; else 0.3 to 8 voxels of the shortest edge",
     "", false, true, false,
     NumberSetting{&Settings::tool_radius_mm, &SettingsUpdate::tool_radius_mm, 0.0, 20.0, 0.0, false}},
    {"viscosity_n_s_per_m", "viscosity", "Viscosity", "N·s/m",
     "drag on all motion of the stylus, in contact and out of it",
     "", false, false, false,
     NumberSetting{&Settings::viscosity_n_s_per_m, &SettingsUpdate::viscosity_n_s_per_m, 0.0, 5.0, 0.0, false}},
    {"pop_force_n", "pop_force", "Pops through at", "N",
     "spring force at which the stylus pops through the surface; that force then fades within 30 ms; 0: never",
     "", true, false, true,
     NumberSetting{&Settings::pop_force_n, &SettingsUpdate::pop_force_n, 0.0, 3.3, 0.0, false}},
    {"magnet_force_n", "magnet_force", "Magnet", "N",
     "greatest pull of the surface on a stylus near it; 0: none",
     "", true, false, false,
     NumberSetting{&Settings::magnet_force_n, &SettingsUpdate::magnet_force_n, 0.0, 1.5, 0.0, false}},
    {"magnet_range_mm", "magnet_range", "Magnet's range", "mm",
     "distance up to which the surface pulls",
     "magnet_force_n", false, false, false,
     NumberSetting{&Settings::magnet_range_mm, &SettingsUpdate::magnet_range_mm, 0.0, 10.0, 2.0, false}},
    {"force_shading", "force_shading", "Force shading", "",
     "force along a normal that varies smoothly over the surface",
     "", true, false, false,
     FlagSetting{&Settings::force_shading, &SettingsUpdate::force_shading, false}},
    {"passivity_control", "passivity_control", "Passivity control", "",
     "the surface gives off no more energy than it took in",
     "", false, false, false,
     FlagSetting{&Settings::passivity_control, &SettingsUpdate::passivity_control, false}},
    {"carve_tool", "carve_tool", "Button 0 carves", "",
     "the stylus carves around the proxy while its button 0 is held",
     "", false, false, false,
     FlagSetting{&Settings::carve_tool, &SettingsUpdate::carve_tool, false}},
    {"carve_radius_mm", "carve_radius", "Carve radius", "mm",
     "radius of the sphere that the stylus carves, on the device",
     "carve_tool", false, true, false,
     NumberSetting{&Settings::carve_radius_mm, &SettingsUpdate::carve_radius_mm, 0.1, 20.0, 2.0, false}},
    {"carve_rate_per_s", "carve_rate", "Carve rate", "1/s",
     "share of the range of values that carving takes away per second; negative: adds",
     "carve_tool", false, false, false,
     NumberSetting{&Settings::carve_rate_per_s, &SettingsUpdate::carve_rate_per_s, -20.0, 20.0, 2.0, false}},
    {"clutch_tool", "clutch_tool", "Button 1 moves the volume", "",
     "the stylus moves the volume, forces off, while its button 1 is held",
     "", false, false, false,
     FlagSetting{&Settings::clutch_tool, &SettingsUpdate::clutch_tool, false}},
    {"free_side", "free_side", "Free side", "",
     "side of the isovalue on which the stylus is free",
     "", false, false, true,
     MakeChoice<&Settings::free_side, &SettingsUpdate::free_side>(FreeSide::kBelow)},
    {"method", "method", "Method", "",
     "how cells are cut into tetrahedra",
     "", false, false, false,
     MakeChoice<&Settings::method, &SettingsUpdate::method>(DecompositionMethod::kTpbcc)},
    {"refinement", "refinement", "Refinement", "",
     "parts that each edge of a voxel is cut into for the felt surface",
     "", false, false, false,
     NumberSetting{&Settings::refinement, &SettingsUpdate::refinement, 1.0, 4.0, 2.0, true}},
}};

}  // namespace palpate::client
