// A choice among the settings, for SettingsUpdate::choices.
#pragma once

#include <algorithm>
#include <string_view>
#include <utility>

#include "server/haptics/settings.h"

namespace palpate::testing {

template <class Enum>
std::pair<const ChoiceSetting*, int> Choice(std::string_view key, Enum value) {
  return {std::ranges::find(kChoiceSettings, key, &ChoiceSetting::key), static_cast<int>(value)};
}

}  // namespace palpate::testing
