#include "client/web/logins/steering_rules.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <variant>

#include "client/sdk/device.h"
#include "client/sdk/placement.h"
#include "client/sdk/settings.h"

namespace palpate::web {
namespace {

const client::Setting* FindSetting(std::string_view key) {
  const auto found =
      std::find_if(client::kSettings.begin(), client::kSettings.end(),
                   [&](const client::Setting& setting) { return setting.key == key; });
  return found == client::kSettings.end() ? nullptr : &*found;
}

bool IsNumberBelow(double count, double value) {
  return value >= 0.0 && value < count && value == std::floor(value);
}

bool IsInRange(const client::Setting& setting, double value) {
  if (!std::isfinite(value)) return false;
  if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
    return number->Allows(value);
  }
  double count = 2.0;  // a flag
  if (const auto* choice = std::get_if<client::ChoiceSetting>(&setting.kind)) {
    count = static_cast<double>(choice->words.size());
  }
  return IsNumberBelow(count, value);
}

}  // namespace

bool IsSetting(std::string_view key) {
  return key == client::kFacingKey || FindSetting(key) != nullptr;
}

std::string SteeringRules::Refusal(const Session& session, std::string_view key, double value,
                                   Time now) {
  if (key == client::kStopKey) return {};
  const auto& allowed = session.may_steer;
  if (!IsSetting(key) || std::find(allowed.begin(), allowed.end(), key) == allowed.end()) {
    return "you may not change this setting";
  }
  const client::Setting* setting = FindSetting(key);
  const bool is_in_range =
      setting ? IsInRange(*setting, value) : IsNumberBelow(client::kFacings, value);
  if (!is_in_range) return "the value is out of range";
  Changes& changes = changes_[session.user];
  Time& oldest = changes.times.at(changes.next);
  if (oldest != Time() && now - oldest < std::chrono::seconds(1)) {
    return "too many changes: at most ten a second";
  }
  oldest = now;
  changes.next = (changes.next + 1) % kMostASecond;
  return {};
}

}  // namespace palpate::web
