#include "server/session/settings_update.h"

#include <string>

#include "common/error/error.h"
#include "server/session/setting_checks.h"

namespace palpate {

double ChosenIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized, double otherwise) {
  if (isovalue && normalized) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue in data units or normalised, not both");
  }
  const VolumeMetadata& metadata = volume.metadata();
  if (isovalue) {
    CheckRange("isovalue", *isovalue, metadata.value_min, metadata.value_max,
               metadata.unit.empty() ? "" : " " + metadata.unit);
    return *isovalue;
  }
  if (!normalized) return otherwise;
  CheckRange("normalized isovalue", *normalized, 0.0, 1.0, "");
  return volume.Denormalize(*normalized);
}

void CheckHaptics(const SurfaceLayers& felt, HapticSettings& haptics) {
  for (const NumberSetting& setting : kNumberSettings) {
    const double value = haptics.*setting.member;
    CheckRange(setting.key, value, setting.low, setting.high, setting.unit);
    if (setting.Allows(value)) continue;
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("{} is {}: it must be {}", setting.key, value, setting.what()));
  }
  OrderLayers(felt, haptics.layers);
  CheckTool(haptics.tool);
}

namespace {

// What an update may not name while there are layers, unless it names them, too.
std::string ReplacedByLayers(const SettingsUpdate& update) {
  if (update.isovalue || update.normalized_isovalue) return "isovalue";
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.of_layers && update.Names(setting.member)) return std::string(setting.key);
  }
  return {};
}

}  // namespace

void CheckReplaced(const SurfaceLayers& felt, const SettingsUpdate& update) {
  if (felt.layer.empty() || update.layers || update.behind_layers) return;
  const std::string key = ReplacedByLayers(update);
  if (key.empty()) return;
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("layers are felt, and each has its own {}: change one of the layers, or "
                          "remove the layers",
                          key));
}

SettingsUpdate WithoutIsovalue(SettingsUpdate update) {
  update.isovalue = update.normalized_isovalue = std::nullopt;
  return update;
}

RenderSettings Changed(const VolumeSnapshot& volume, RenderSettings settings,
                       const SettingsUpdate& update) {
  CheckReplaced(settings.haptics.layers, update);
  if (update.isovalue || update.normalized_isovalue) {
    settings.isovalue = ChosenIsovalue(volume, update.isovalue, update.normalized_isovalue, 0.0);
    settings.normalized_isovalue = volume.Normalize(settings.isovalue);
  }
  HapticSettings& haptics = settings.haptics;
  const SurfaceLayers felt = haptics.layers;
  for (const auto& [member, value] : update.numbers) haptics.*member = value;
  for (const auto& [member, value] : update.flags) haptics.*member = value;
  for (const auto& [setting, number] : update.choices) setting->set(haptics, number);
  if (update.layers) haptics.layers = *update.layers;
  if (update.tool) haptics.tool = *update.tool;
  CheckHaptics(felt, haptics);
  return settings;
}

}  // namespace palpate
