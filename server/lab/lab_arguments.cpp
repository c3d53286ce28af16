#include "server/lab/lab_arguments.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <charconv>
#include <cstdio>
#include <string_view>
#include <vector>

#include "common/error/error.h"
#include "server/live_volume/volume_loader.h"
#include "server/volume/load/builtin.h"
#include "server/volume/snapshot/snapshot_builder.h"

namespace palpate::lab {

std::filesystem::path ImportProgramBesideThis() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "palpate-import";
}

std::shared_ptr<const VolumeSnapshot> LoadVolume(const std::string& source,
                                                 const std::filesystem::path& import_program,
                                                 const StageProgress& progress,
                                                 const std::optional<Vec3>& spacing_mm) {
  const std::string absolute =
      IsBuiltin(source) ? source : std::filesystem::absolute(source).string();
  const VolumeLoader loader{.import_program = import_program};
  std::vector<std::string> warnings;
  const LoadedVolume volume = loader.Load(
      {.source = absolute, .spacing_mm = spacing_mm},
      [&](std::string_view stage, double fraction) {
        if (progress) progress(stage, fraction);
      },
      [] { return false; }, warnings);
  for (const std::string& warning : warnings) {
    std::fprintf(stderr, "%s: %s\n", source.c_str(), warning.c_str());
  }
  return std::make_shared<const VolumeSnapshot>(volume.metadata, volume.bricks, 1, 1);
}

double ChooseIsovalue(const VolumeSnapshot& volume, const std::optional<double>& isovalue,
                      const std::optional<double>& normalized_isovalue) {
  if (isovalue.has_value() == normalized_isovalue.has_value()) {
    throw Error(ErrorKind::kInvalidArgument,
                "give the isovalue either in data units or normalised");
  }
  const double density = isovalue ? volume.Normalize(*isovalue) : *normalized_isovalue;
  if (!(density >= 0.0 && density <= 1.0)) {
    const VolumeMetadata& metadata = volume.metadata();
    char text[160];
    std::snprintf(text, sizeof text,
                  "the isovalue %g is outside of the volume's range, %g to %g (normalised: 0 to 1)",
                  isovalue ? *isovalue : *normalized_isovalue, metadata.value_min,
                  metadata.value_max);
    throw Error(ErrorKind::kInvalidArgument, text);
  }
  return density;
}

namespace {

std::string KnownKeys() {
  std::string keys;
  for (const NumberSetting& setting : kNumberSettings) keys += fmt::format("{}, ", setting.key);
  for (const FlagSetting& setting : kFlagSettings) keys += fmt::format("{}, ", setting.key);
  for (const ChoiceSetting& setting : kChoiceSettings) keys += fmt::format("{}, ", setting.key);
  return keys.substr(0, keys.size() - 2);
}

void SetNumber(const NumberSetting& setting, std::string_view value, HapticSettings& settings) {
  double number = 0.0;
  const auto [stop, status] = std::from_chars(value.data(), value.data() + value.size(), number);
  const bool is_number = status == std::errc() && stop == value.data() + value.size();
  if (!is_number || !setting.Allows(number)) {
    Refuse(fmt::format("{}={}: give {} from {} to {}{}", setting.key, value, setting.what(),
                       setting.low, setting.high, setting.unit));
  }
  settings.*setting.member = number;
}

void SetFlag(const FlagSetting& setting, std::string_view value, HapticSettings& settings) {
  const bool on = value == "on" || value == "true";
  if (!on && value != "off" && value != "false") {
    Refuse(fmt::format("{}={}: give on or off", setting.key, value));
  }
  settings.*setting.member = on;
}

void SetChoice(const ChoiceSetting& setting, std::string_view value, HapticSettings& settings) {
  const std::optional<int> number = NumberOf(setting, value);
  if (!number) {
    Refuse(fmt::format("{}={}: give {}", setting.key, value, fmt::join(setting.words, " or ")));
  }
  setting.set(settings, *number);
}

}  // namespace

void ApplySetting(const std::string& argument, HapticSettings& settings) {
  const std::size_t equals = argument.find('=');
  if (equals == std::string::npos) Refuse(argument + ": give a setting as key=value");
  const std::string key = argument.substr(0, equals), value = argument.substr(equals + 1);
  for (const NumberSetting& setting : kNumberSettings) {
    if (key == setting.key) return SetNumber(setting, value, settings);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    if (key == setting.key) return SetFlag(setting, value, settings);
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (key == setting.key) return SetChoice(setting, value, settings);
  }
  Refuse(key + ": no such setting; the settings are " + KnownKeys());
}

}  // namespace palpate::lab
