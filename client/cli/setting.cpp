#include "client/cli/setting.h"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <variant>
#include "common/error/number_text.h"

namespace palpate::cli {
namespace {

using client::ChoiceSetting;
using client::FlagSetting;
using client::NumberSetting;

std::optional<double> ParseNumber(const std::string& text) {
  double value = 0.0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || rest != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<bool> ParseFlag(const std::string& text) {
  if (text == "on" || text == "true") return true;
  if (text == "off" || text == "false") return false;
  return std::nullopt;
}

// Parses a text into an update. Returns false if the text is not a valid value.
struct Store {
  const std::string& text;
  client::SettingsUpdate& update;

  bool operator()(const NumberSetting& number) const {
    const std::optional<double> value = ParseNumber(text);
    if (value) update.*number.update = value;
    return value.has_value();
  }
  bool operator()(const FlagSetting& flag) const {
    const std::optional<bool> value = ParseFlag(text);
    if (value) update.*flag.update = value;
    return value.has_value();
  }
  bool operator()(const ChoiceSetting& choice) const {
    const auto word = std::find(choice.words.begin(), choice.words.end(), text);
    if (word == choice.words.end()) return false;
    choice.update(update, static_cast<std::size_t>(word - choice.words.begin()));
    return true;
  }
};

struct KindToJson {
  const client::Settings& settings;

  nlohmann::ordered_json operator()(const NumberSetting& number) const {
    return settings.*number.member;
  }
  nlohmann::ordered_json operator()(const FlagSetting& flag) const { return settings.*flag.member; }
  nlohmann::ordered_json operator()(const ChoiceSetting& choice) const {
    return choice.words[choice.get(settings)];
  }
};

std::string WithUnit(const std::string& text, const Setting& setting) {
  return setting.unit.empty() ? text : fmt::format("{} {}", text, setting.unit);
}

}  // namespace

const Setting* FindSetting(std::string_view name) {
  const auto found =
      std::find_if(client::kSettings.begin(), client::kSettings.end(),
                   [name](const Setting& s) { return s.name == name || s.key == name; });
  return found == client::kSettings.end() ? nullptr : &*found;
}

std::vector<std::string_view> WordsOf(const Setting& setting) {
  if (std::holds_alternative<FlagSetting>(setting.kind)) return {"on", "off"};
  const auto* choice = std::get_if<ChoiceSetting>(&setting.kind);
  if (!choice) return {};
  return {choice->words.begin(), choice->words.end()};
}

std::string ValuesOf(const Setting& setting) {
  if (const auto* number = std::get_if<NumberSetting>(&setting.kind)) {
    if (!std::isfinite(number->maximum)) return "a number";
    const char* const whole = number->whole ? ", whole" : "";
    return WithUnit(fmt::format("{:g} to {:g}{}", number->minimum, number->maximum, whole),
                    setting);
  }
  const std::vector<std::string_view> words = WordsOf(setting);
  std::string text;
  for (std::size_t n = 0; n < words.size(); ++n) {
    if (n > 0) text += n + 1 < words.size() ? ", " : " or ";
    text += words[n];
  }
  return text;
}

std::string ListOfSettings() {
  std::string text;
  for (const Setting& setting : client::kSettings) {
    text += fmt::format("  {:<20}{}; {}\n", setting.name, ValuesOf(setting), setting.help);
  }
  return text;
}

bool StoreSetting(const Setting& setting, const std::string& text, client::SettingsUpdate& update) {
  return std::visit(Store{text, update}, setting.kind);
}

nlohmann::ordered_json SettingJson(const Setting& setting, const client::Settings& settings) {
  if (!client::IsKnown(settings, setting)) return nullptr;
  return std::visit(KindToJson{settings}, setting.kind);
}

std::string DescribeSetting(const Setting& setting, const client::Settings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  std::string text = "unknown";
  if (value.is_number()) text = WithUnit(NumberText(value.get<double>()), setting);
  if (value.is_boolean()) text = value.get<bool>() ? "on" : "off";
  if (value.is_string()) text = value.get<std::string>();
  return fmt::format("{} {}", setting.name, text);
}

bool IsOff(const Setting& setting, const client::Settings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  return value == 0.0 || value == false;
}

}  // namespace palpate::cli
