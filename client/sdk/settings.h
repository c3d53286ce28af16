// The settings: isovalue, stiffness, effects, method. Forces and lengths are those of the device.
//
// setting_list.h is generated from the contract's list (proto/palpate/v1/render.proto). It has
//   Settings        a member for each setting, with its default; what the daemon holds
//   SettingsUpdate  the same members as optionals: what is to change
//   kSettings       each setting's name, unit, range, default and effect
//
// Threads: plain values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "client/sdk/setting.h"
#include "client/sdk/setting_list.h"
#include "common/contract/render.h"  // SurfaceLayers, which Settings holds

namespace palpate::client {

// Two forms of one value. An update has at most one of them.
inline constexpr const Setting& kIsovalue = kSettings[0];
inline constexpr const Setting& kNormalizedIsovalue = kSettings[1];
// All other settings.
inline constexpr std::span<const Setting> kHapticSettings = std::span(kSettings).subspan(2);

// True if `settings` has a value of `setting`, which is one of kSettings. False if a daemon of
// another version lacks the setting or has an unknown choice for it.
inline bool IsKnown(const Settings& settings, const Setting& setting) {
  return !settings.unknown.test(static_cast<std::size_t>(&setting - kSettings.data()));
}

struct SettingsResult {
  Settings settings;                       // after the update
  std::uint64_t applied_tick = 0;          // first tick that used them
  std::int64_t receipt_to_applied_ns = 0;  // from the daemon's receipt to the start of that tick
  // Why the update is not kept for palpated's next start; empty: it is.
  std::string not_kept{};
};

}  // namespace palpate::client
