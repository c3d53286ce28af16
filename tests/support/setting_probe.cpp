// setting_probe KEY: where a setting has come to, a line for each place. Compiled by
// settings_scratch_test.py against what is written from a list that has one setting more.
#include <fmt/core.h>

#include <string>
#include <variant>

#include "client/cli/setting.h"
#include "client/sdk/settings.h"
#include "client/view/palpated/setting_change.h"
#include "server/haptics/settings.h"

using namespace palpate;

int main(int, char** arguments) {
  const std::string key = arguments[1];
  const HapticSettings felt;
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.key != key) continue;
    fmt::print("daemon's check: {} from {:g} to {:g}{}, {:g} at first\n", key, setting.low,
               setting.high, setting.unit, felt.*setting.member);
  }
  const client::Setting* setting = cli::FindSetting(key);
  if (!setting) return 1;
  client::SettingsUpdate update;
  if (!cli::StoreSetting(*setting, "1.25", update)) return 1;
  const auto& number = std::get<client::NumberSetting>(setting->kind);
  fmt::print("palpate set: {} {:g}; give {}\n", setting->name, *(update.*number.update),
             cli::ValuesOf(*setting));
  fmt::print("palpate settings: {}\n", cli::DescribeSetting(*setting, client::Settings()));
  std::string names;
  for (const client::Setting& each : client::kSettings) names.append(" ").append(each.name);
  fmt::print("completion list:{}\n", names);
  if (view::IsShown(*setting, client::Settings())) {
    fmt::print("viewer's panel: slider '{}' from {:g} to {:g}, '{}'\n", setting->label,
               number.minimum, number.maximum, view::SliderFormat(*setting));
  }
  return 0;
}
