// The types of settings in the generated list (setting_list.h), with the names that configuration
// files, clients and command lines use.
//
// Threads: plain values.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace palpate {

struct HapticSettings;

struct NumberSetting {
  std::string_view key;
  double HapticSettings::*member;
  double low, high;
  std::string_view unit;  // with a leading blank; empty: a ratio
};

struct FlagSetting {
  std::string_view key;
  bool HapticSettings::*member;
};

// The side of H on which the proxy is free: where densities are below τ, or where they are above τ
// (to feel a cavity from the inside).
enum class FreeSide : std::uint8_t { kBelow, kAbove };

inline constexpr std::array<std::string_view, 2> kFreeSideNames = {"below", "above"};
constexpr std::string_view FreeSideName(FreeSide side) {
  return kFreeSideNames[static_cast<std::size_t>(side)];
}
constexpr std::optional<FreeSide> FreeSideNamed(std::string_view name) {
  for (std::size_t n = 0; n < kFreeSideNames.size(); ++n) {
    if (kFreeSideNames[n] == name) return static_cast<FreeSide>(n);
  }
  return std::nullopt;
}

}  // namespace palpate
