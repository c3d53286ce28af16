// The types of settings in the generated list (setting_list.h), with the names that configuration
// files, clients and command lines use.
//
// Threads: plain values.
#pragma once

#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>

#include "common/contract/enumerations.h"

namespace palpate {

struct HapticSettings;

struct NumberSetting {
  std::string_view key;
  double HapticSettings::*member;
  double low, high;
  std::string_view unit;  // with a leading blank; empty: a ratio
  bool whole;
  bool refused_with_tool;  // while a rigid tool is held, it must be 0
  bool of_layers;          // each layer has its own

  // False for NaN.
  bool Allows(double value) const {
    return value >= low && value <= high && (!whole || value == std::floor(value));
  }
  std::string_view what() const { return whole ? "a whole number" : "a number"; }
};

struct FlagSetting {
  std::string_view key;
  bool HapticSettings::*member;
  bool refused_with_tool;  // it must be off
};

// A choice among enumerators, by their numbers.
struct ChoiceSetting {
  std::string_view key;
  std::span<const std::string_view> words;  // word n: of the enumerator n + 1
  int (*get)(const HapticSettings&);
  void (*set)(HapticSettings&, int);
};

template <auto Member, class Settings = HapticSettings>
constexpr ChoiceSetting MakeChoice(std::string_view key) {
  using Enum = std::remove_cvref_t<decltype(std::declval<Settings>().*Member)>;
  return {key, kWords<Enum>,
          [](const Settings& settings) { return static_cast<int>(settings.*Member); },
          [](Settings& settings, int number) { settings.*Member = EnumeratorOf<Enum>(number); }};
}

// The number of the enumerator with this word; none: there is none.
constexpr std::optional<int> NumberOf(const ChoiceSetting& setting, std::string_view word) {
  for (std::size_t n = 0; n < setting.words.size(); ++n) {
    if (setting.words[n] == word) return static_cast<int>(n) + 1;
  }
  return std::nullopt;
}

// The word of a number that is none of kUnknown.
constexpr std::string_view WordOf(const ChoiceSetting& setting, int number) {
  return setting.words[static_cast<std::size_t>(number) - 1];
}

}  // namespace palpate
