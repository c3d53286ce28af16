// The palette as Dear ImGui's style.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <array>

#include "client/view/app/palette.h"

namespace palpate::view {

// Sets the colours of all controls. Call it between frames, or take a ThemeScope.
void UseTheme(Theme theme);
const Palette& CurrentPalette();

// What is drawn meanwhile has the other theme's colours: on the picture, which is always dark.
class ThemeScope {
 public:
  explicit ThemeScope(Theme theme);
  ~ThemeScope();
  ThemeScope(const ThemeScope&) = delete;
  ThemeScope& operator=(const ThemeScope&) = delete;

 private:
  Theme before_;
};

// A colour of the current palette, as Dear ImGui wants it.
class ThemeColor {
 public:
  explicit constexpr ThemeColor(Rgba Palette::*member) : member_(member) {}
  operator ImVec4() const {  // NOLINT(google-explicit-constructor): stands for an ImVec4
    const Rgba& color = CurrentPalette().*member_;
    return {color.r, color.g, color.b, color.a};
  }
  ImU32 u32() const { return ImGui::ColorConvertFloat4ToU32(*this); }

 private:
  Rgba Palette::*member_;
};

inline constexpr ThemeColor kPlain(&Palette::text);
inline constexpr ThemeColor kGood(&Palette::good);
inline constexpr ThemeColor kWarning(&Palette::warning);
inline constexpr ThemeColor kBad(&Palette::bad);
inline constexpr ThemeColor kDim(&Palette::dim);
inline constexpr ThemeColor kMessageGround(&Palette::message);

}  // namespace palpate::view
