// Describes each setting: its name, unit, range, default and effect, and how to read and change it.
// kSettings (settings.h) lists all settings. Panels, command lines and files can be made from the
// list.
//
// Threads: plain values.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <variant>

#include "client/sdk/pose.h"
#include "common/isosurface/decomposition.h"

namespace palpate::client {

struct Settings;
struct SettingsUpdate;

struct NumberSetting {
  double Settings::*member;
  std::optional<double> SettingsUpdate::*update;
  double minimum, maximum;  // infinite for the isovalue: the volume has its range
  double initial;
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
  std::string_view shown_with;  // key of a flag: while the flag is off, this setting has no effect
  std::variant<NumberSetting, FlagSetting, ChoiceSetting> kind;
};

// Returns the index of `value` among the enumerators of a choice.
template <typename Enum, std::size_t Count>
constexpr std::size_t PlaceOf(Enum value, const std::array<Enum, Count>& values) {
  return static_cast<std::size_t>(std::find(values.begin(), values.end(), value) - values.begin());
}

// A choice among `Values`: enumerators, in the order of `words`.
template <auto Member, auto Update, const auto& Values>
constexpr ChoiceSetting MakeChoice(std::span<const std::string_view> words, std::size_t initial) {
  return {words,
          initial,
          [](const Settings& settings) { return PlaceOf(settings.*Member, Values); },
          [](Settings& settings, std::size_t place) { settings.*Member = Values.at(place); },
          [](const SettingsUpdate& update) {
            const auto& value = update.*Update;
            return value ? std::optional(PlaceOf(*value, Values)) : std::nullopt;
          },
          [](SettingsUpdate& update, std::size_t place) { update.*Update = Values.at(place); }};
}

}  // namespace palpate::client
