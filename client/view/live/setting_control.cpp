#include "client/view/live/setting_control.h"

#include <algorithm>
#include <variant>

namespace palpate::view {

bool IsShown(const client::Setting& setting, const client::Settings& settings) {
  const auto tool =
      std::find_if(client::kSettings.begin(), client::kSettings.end(),
                   [&](const client::Setting& s) { return s.key == setting.shown_with; });
  if (tool == client::kSettings.end()) return true;
  const auto* flag = std::get_if<client::FlagSetting>(&tool->kind);
  return !flag || settings.*flag->member;
}

std::string SliderFormat(const client::Setting& setting) {
  const auto& number = std::get<client::NumberSetting>(setting.kind);
  // A pixel of the slider is about a hundredth of the range.
  std::string format = number.maximum - number.minimum < 10.0 ? "%.2f" : "%.1f";
  if (!setting.unit.empty()) format.append(" ").append(setting.unit);
  return format;
}

}  // namespace palpate::view
