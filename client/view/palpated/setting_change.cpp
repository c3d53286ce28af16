#include "client/view/palpated/setting_change.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "common/error/error.h"

namespace palpate::view {
namespace {

// Other clients may change other settings between our question and our answer to it.
constexpr int kMostTries = 20;

[[noreturn]] void ThrowChangedBy(const std::string& who) {
  throw Error(ErrorKind::kConflict,
              (who.empty() ? "somebody else has changed it since" : "changed since by " + who) +
                  ", so it stays");
}

}  // namespace

bool IsShown(const client::Setting& setting, const client::Settings& settings) {
  const bool has_tool = !settings.tool.ball.empty();
  if (has_tool && (setting.refused_with_tool || setting.idle_with_tool)) return false;
  if (!settings.layers.layer.empty() && setting.of_layers) return false;
  const auto shown_with =
      std::find_if(client::kSettings.begin(), client::kSettings.end(),
                   [&](const client::Setting& s) { return s.key == setting.shown_with; });
  return shown_with == client::kSettings.end() || ValueOf(*shown_with, settings) != 0.0;
}

std::string SliderFormat(const client::Setting& setting) {
  const auto& number = std::get<client::NumberSetting>(setting.kind);
  // A pixel of the slider is about a hundredth of the range.
  std::string format = number.whole                             ? "%.0f"
                       : number.maximum - number.minimum < 10.0 ? "%.2f"
                                                                : "%.1f";
  if (!setting.unit.empty()) format.append(" ").append(setting.unit);
  return format;
}

double ValueOf(const client::Setting& setting, const client::Settings& settings) {
  if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
    return settings.*number->member;
  }
  if (const auto* flag = std::get_if<client::FlagSetting>(&setting.kind)) {
    return settings.*flag->member ? 1.0 : 0.0;
  }
  return static_cast<double>(std::get<client::ChoiceSetting>(setting.kind).get(settings));
}

client::SettingsUpdate UpdateTo(const client::Setting& setting, double value) {
  client::SettingsUpdate update;
  SetIn(setting, value, update);
  return update;
}

void SetIn(const client::Setting& setting, double value, client::SettingsUpdate& update) {
  if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
    update.*number->update = value;
  } else if (const auto* flag = std::get_if<client::FlagSetting>(&setting.kind)) {
    update.*flag->update = value > 0.5;
  } else {
    std::get<client::ChoiceSetting>(setting.kind).update(update, static_cast<std::size_t>(value));
  }
}

bool IsSame(double a, double b) { return std::abs(a - b) <= 1e-9 * (1.0 + std::abs(b)); }

std::optional<SettingChange> SettingDrag::Add(const SettingChange& change) {
  if (open_ && open_->setting == change.setting) {
    open_->after = change.after;
    return std::nullopt;
  }
  std::optional<SettingChange> ended = End();
  open_ = change;
  return ended;
}

std::optional<SettingChange> SettingDrag::End() {
  const std::optional<SettingChange> ended = std::exchange(open_, std::nullopt);
  if (!ended || ended->before == ended->after) return std::nullopt;
  return ended;
}

void RestoreSetting(const SettingChange& change, bool forward, const SettingAccess& access) {
  const double from = forward ? change.before : change.after;
  const double to = forward ? change.after : change.before;
  for (int left = kMostTries; left > 0; --left) {
    const client::Settings now = access.get();
    if (!IsSame(ValueOf(*change.setting, now), from)) ThrowChangedBy(access.changed_by());
    client::SettingsUpdate update = UpdateTo(*change.setting, to);
    update.expected_revision = now.revision;
    try {
      access.set(update);
      return;
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kConflict || left == 1) throw;
    }
  }
}

}  // namespace palpate::view
