#include "server/lab/setting_arguments.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <charconv>
#include <string_view>

#include "common/error/error.h"

namespace palpate::lab {
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
