#include "server/recording/settings_text.h"

#include <array>
#include <charconv>
#include <optional>

#include "server/recording/bytes.h"

namespace palpate {
namespace {

constexpr std::array<std::string_view, 2> kFlagNames = {"off", "on"};

double ParseNumber(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw DamagedBytes("damaged: a setting is no number");
  }
  return value;
}

bool ParseFlag(std::string_view text) {
  if (text != kFlagNames[0] && text != kFlagNames[1]) {
    throw DamagedBytes("damaged: a setting is neither on nor off");
  }
  return text == kFlagNames[1];
}

// False if no setting has this name.
bool Set(HapticSettings& settings, std::string_view key, std::string_view value) {
  for (const NumberSetting& number : kNumberSettings) {
    if (number.key == key) {
      settings.*number.member = ParseNumber(value);
      return true;
    }
  }
  for (const FlagSetting& flag : kFlagSettings) {
    if (flag.key == key) {
      settings.*flag.member = ParseFlag(value);
      return true;
    }
  }
  for (const ChoiceSetting& choice : kChoiceSettings) {
    if (choice.key == key) {
      const std::optional<int> number = NumberOf(choice, value);
      if (!number) throw DamagedBytes("damaged: a setting is none of its words");
      choice.set(settings, *number);
      return true;
    }
  }
  return false;
}

}  // namespace

std::string SettingsText(const HapticSettings& settings) {
  std::string text;
  const auto add = [&](std::string_view key, std::string_view value) {
    text.append(key).append("=").append(value).append("\n");
  };
  for (const NumberSetting& number : kNumberSettings) {
    std::array<char, 32> digits;
    const auto end =
        std::to_chars(digits.data(), digits.data() + digits.size(), settings.*number.member).ptr;
    add(number.key, {digits.data(), static_cast<std::size_t>(end - digits.data())});
  }
  for (const FlagSetting& flag : kFlagSettings) add(flag.key, kFlagNames[settings.*flag.member]);
  for (const ChoiceSetting& choice : kChoiceSettings) {
    if (choice.key == "method") continue;  // the scene has it
    add(choice.key, WordOf(choice, choice.get(settings)));
  }
  return text;
}

HapticSettings SettingsFromText(std::string_view text, std::vector<std::string>& unknown) {
  HapticSettings settings;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    const std::size_t equals = line.find('=');
    if (end == std::string_view::npos || equals == std::string_view::npos) {
      throw DamagedBytes("damaged: a setting is no line key=value");
    }
    const std::string_view key = line.substr(0, equals);
    if (!Set(settings, key, line.substr(equals + 1))) unknown.emplace_back(key);
    text.remove_prefix(end + 1);
  }
  return settings;
}

}  // namespace palpate
