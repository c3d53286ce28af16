// What is felt: isovalue, stiffness, effects, method. README lists units, ranges and
// defaults; forces and lengths are those of the device.
//
// Threads: plain values.
#pragma once

#include <cstdint>
#include <optional>

#include "client/sdk/pose.h"
#include "common/isosurface/decomposition.h"

namespace palpate::client {

struct Settings {
  double isovalue = 0.0;             // data units
  double normalized_isovalue = 0.0;  // the same over the range fixed at load, 0 to 1
  double stiffness_n_per_mm = 0.0;
  double damping_n_s_per_m = 0.0;
  DecompositionMethod method = DecompositionMethod::kTpbcc;
  double static_friction = 0.0;
  double dynamic_friction = 0.0;
  double viscosity_n_s_per_m = 0.0;
  double pop_force_n = 0.0;
  double magnet_force_n = 0.0;
  double magnet_range_mm = 0.0;
  bool force_shading = false;
  bool passivity_control = false;
  FreeSide free_side = FreeSide::kBelow;
  bool carve_tool = false;
  double carve_radius_mm = 0.0;
  double carve_rate_per_s = 0.0;
  bool clutch_tool = false;

  // Rises with every change of settings, of where the volume lies, and with every
  // volume that is loaded; begins anew with every start of the daemon.
  std::uint64_t revision = 0;
};

// What is to change, all at one tick; what is absent stays.
struct SettingsUpdate {
  // At most one of the two.
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

  // Refuse with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

struct SettingsResult {
  Settings settings;               // after the update
  std::uint64_t applied_tick = 0;  // first tick that used them
};

}  // namespace palpate::client
