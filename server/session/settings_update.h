// A change of the settings, and what it makes of them.
//
// Threads: pure functions. Errors: Error (kInvalidArgument).
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "common/contract/enumerations.h"
#include "common/contract/render.h"
#include "server/felt/scene.h"
#include "server/haptics/settings.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

// The changes to make. Give the isovalue in at most one of its two forms.
struct SettingsUpdate {
  std::optional<double> isovalue{};
  std::optional<double> normalized_isovalue{};
  // Members of RenderSettings::haptics and their new values.
  std::vector<std::pair<double HapticSettings::*, double>> numbers{};
  std::vector<std::pair<bool HapticSettings::*, bool>> flags{};
  // Settings of kChoiceSettings and the numbers of their enumerators.
  std::vector<std::pair<const ChoiceSetting*, int>> choices{};
  std::optional<SurfaceLayers> layers{};
  std::optional<HeldTool> tool{};
  bool behind_layers = false;  // may change what layers replace, although they are felt
  std::optional<std::uint64_t> expected_revision{};

  bool Names(double HapticSettings::*number) const {
    return std::ranges::any_of(numbers, [&](const auto& one) { return one.first == number; });
  }
  // The ball or the tool.
  bool NamesTip() const { return tool || Names(&HapticSettings::tool_radius_mm); }
};

// For a volume whose range is not known yet.
SettingsUpdate WithoutIsovalue(SettingsUpdate update);

// Takes the isovalue in the form that was given. Throws if it is given in both, or out of range.
double ChosenIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized, double otherwise);

// Checks numbers and the tool, and puts layers in order. `felt`: the layers until now, which keep
// their ids.
void CheckHaptics(const SurfaceLayers& felt, HapticSettings& haptics);

// Throws if the update changes what the felt layers replace.
void CheckReplaced(const SurfaceLayers& felt, const SettingsUpdate& update);

// Without a look at what depends on the volume: the layers' isovalues, the side and the tip.
RenderSettings Changed(const VolumeSnapshot& volume, RenderSettings settings,
                       const SettingsUpdate& update);

// What the update makes of a choice; none: it stays.
template <class Enum>
std::optional<Enum> Chosen(const SettingsUpdate& update, std::string_view key) {
  for (const auto& [setting, number] : update.choices) {
    if (setting->key == key) return EnumeratorOf<Enum>(number);
  }
  return std::nullopt;
}

}  // namespace palpate
