// What `palpate set` changes and `palpate settings` shows: one list, by which
// settings are named, read and written. The isovalue stands apart for its two
// forms.
//
// Pure; any thread.
#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "palpate/v1/render.pb.h"

namespace palpate::cli {

struct Setting {
  std::string_view key;     // field of v1::RenderSettings
  std::string_view name;    // the key without its unit
  std::string_view values;  // what it may be, in words, with the unit
  std::string_view unit;    // with a leading blank; empty: none
  std::string_view about;
};

inline constexpr Setting kIsovalue = {"isovalue", "isovalue", "a number in data units", "",
                                      "which surface is felt"};
inline constexpr Setting kNormalizedIsovalue = {
    "normalized_isovalue", "normalized_isovalue", "0 to 1", "",
    "the same over the volume's range at load; also: isovalue --normalized"};

inline constexpr std::array<Setting, 16> kSettings = {{
    {"stiffness_n_per_mm", "stiffness", "0 to 3 N/mm", " N/mm",
     "force per device motion into the surface"},
    {"damping_n_s_per_m", "damping", "0 to 5 N·s/m", " N·s/m",
     "against motion along the surface's normal, in contact"},
    {"static_friction", "static_friction", "0 to 2", "",
     "tangential per normal force at rest; one below the dynamic has no effect"},
    {"dynamic_friction", "dynamic_friction", "0 to 2", "", "the same while sliding"},
    {"viscosity_n_s_per_m", "viscosity", "0 to 5 N·s/m", " N·s/m",
     "drag on all motion of the stylus"},
    {"pop_force_n", "pop_force", "0 to 3.3 N", " N",
     "spring force at which the stylus pops through the surface; 0: never"},
    {"magnet_force_n", "magnet_force", "0 to 1.5 N", " N",
     "greatest pull of the surface on a stylus near it"},
    {"magnet_range_mm", "magnet_range", "0 to 10 mm", " mm", "distance up to which it pulls"},
    {"force_shading", "force_shading", "on or off", "",
     "force along a normal that varies smoothly over the surface"},
    {"passivity_control", "passivity_control", "on or off", "",
     "the surface gives off no more energy than it took in"},
    {"free_side", "free_side", "below or above", "",
     "side of the isovalue on which the stylus is free"},
    {"carve_tool", "carve_tool", "on or off", "",
     "the stylus carves around the proxy while its button 0 is held"},
    {"carve_radius_mm", "carve_radius", "0.1 to 20 mm", " mm", "of the sphere that it carves"},
    {"carve_rate_per_s", "carve_rate", "-20 to 20 1/s", " 1/s",
     "share of the range of values taken away per second; negative: added"},
    {"clutch_tool", "clutch_tool", "on or off", "",
     "the stylus moves the volume, forces off, while its button 1 is held"},
    {"method", "method", "tpbcc, bcc, tptd or tpbcc-published", "",
     "how cells are cut; tpbcc keeps topology"},
}};

// By its name or key, the isovalue's included; null: there is none.
const Setting* FindSetting(std::string_view name);

// Puts `text` into the setting's field; false, and nothing is put, where `text` is
// no value of its kind. The daemon knows the ranges.
bool StoreSetting(const Setting& setting, const std::string& text, v1::RenderSettings& settings);

// Number, true or false, or name; null where `settings` has none.
nlohmann::ordered_json SettingJson(const Setting& setting, const v1::RenderSettings& settings);

// Such as "stiffness 0.5 N/mm", "force_shading on", "method bcc".
std::string DescribeSetting(const Setting& setting, const v1::RenderSettings& settings);

// 0 or false.
bool IsOff(const Setting& setting, const v1::RenderSettings& settings);

}  // namespace palpate::cli
