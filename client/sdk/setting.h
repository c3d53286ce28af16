// Describes each setting: its name, unit, range, default and effect, and how to read and change it.
// kSettings (settings.h) lists all settings. Panels, command lines and files can be made from the
// list.
//
// Threads: plain values.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <variant>

#include "client/sdk/pose.h"
#include "common/contract/enumerations.h"

namespace palpate::client {

struct Settings;
struct SettingsUpdate;

struct NumberSetting {
  double Settings::*member;
  std::optional<double> SettingsUpdate::*update;
  double minimum, maximum;  // infinite for the isovalue: the volume has its range
  double initial;
  bool whole;  // only whole numbers

  // False for NaN.
  bool Allows(double value) const {
    return value >= minimum && value <= maximum && (!whole || value == std::floor(value));
  }
};

struct FlagSetting {
  bool Settings::*member;
  std::optional<bool> SettingsUpdate::*update;
  bool initial;
};

// A choice of several words, numbered from 0. palpate.v1 numbers the same words from 1, in the same
// order.
struct ChoiceSetting {
  std::span<const std::string_view> words;
  std::size_t initial;
  std::size_t (*get)(const Settings&);
  void (*set)(Settings&, std::size_t);
  std::optional<std::size_t> (*updated)(const SettingsUpdate&);
  void (*update)(SettingsUpdate&, std::size_t);
};

struct Setting {
  // Each text ends with \0.
  std::string_view key;         // with its unit: stiffness_n_per_mm
  std::string_view name;        // without the unit: stiffness
  std::string_view label;       // for panels: Stiffness
  std::string_view unit;        // N/mm; empty: a ratio, or not a number
  std::string_view help;        // its effect, in one line that begins with a small letter
  // Key of a flag or a number: while that is off or 0, this setting has no effect.
  std::string_view shown_with;
  bool refused_with_tool;  // while a rigid tool is held, it must be 0 or off
  bool idle_with_tool;     // no effect on a rigid tool
  bool of_layers;          // each layer has its own: no change while there are layers
  std::variant<NumberSetting, FlagSetting, ChoiceSetting> kind;
};

template <Declared Enum>
constexpr std::size_t PlaceOf(Enum value) {
  return static_cast<std::size_t>(value) - 1;
}

template <Declared Enum>
constexpr Enum AtPlace(std::size_t place) {
  return EnumeratorOf<Enum>(static_cast<int>(place) + 1);
}

template <auto Member, auto Update, Declared Enum>
constexpr ChoiceSetting MakeChoice(Enum initial) {
  return {kWords<Enum>,
          PlaceOf(initial),
          [](const Settings& settings) { return PlaceOf(settings.*Member); },
          [](Settings& settings, std::size_t place) { settings.*Member = AtPlace<Enum>(place); },
          [](const SettingsUpdate& update) {
            const std::optional<Enum>& value = update.*Update;
            return value ? std::optional(PlaceOf(*value)) : std::nullopt;
          },
          [](SettingsUpdate& update, std::size_t place) { update.*Update = AtPlace<Enum>(place); }};
}

}  // namespace palpate::client
