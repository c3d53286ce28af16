// The colours of the panels, dark and light, in Dear ImGui's style. The picture, its overlays and
// the slices are drawn on a dark ground in both.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include "client/view/viewer/preferences.h"

namespace palpate::view {

struct Palette {
  // Grounds.
  ImVec4 ground;  // of the panels
  ImVec4 field;   // of controls and plots
  ImVec4 histogram;
  ImVec4 header;
  ImVec4 popup;
  ImVec4 message;  // under a line over the picture
  // Of buttons, and of what is chosen.
  ImVec4 button;
  ImVec4 hovered;
  ImVec4 active;
  // Texts, readable on all grounds.
  ImVec4 text;
  ImVec4 dim;
  ImVec4 good;
  ImVec4 warning;
  ImVec4 bad;
  ImVec4 suggestion;  // names of isovalues, on the histogram
  // Marks.
  ImVec4 isovalue;
  ImVec4 material;    // bars of the histogram that are felt
  ImVec4 other_bars;  // bars of the histogram that are not
  ImVec4 line;        // of plots
};

const Palette& PaletteOf(Theme theme);

// Sets the colours of all controls. Call it between frames, or take a ThemeScope.
void UseTheme(Theme theme);

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
  explicit constexpr ThemeColor(ImVec4 Palette::*member) : member_(member) {}
  operator ImVec4() const;  // NOLINT(google-explicit-constructor): stands for an ImVec4
  ImU32 u32() const { return ImGui::ColorConvertFloat4ToU32(*this); }

 private:
  ImVec4 Palette::*member_;
};

inline constexpr ThemeColor kPlain(&Palette::text);
inline constexpr ThemeColor kGood(&Palette::good);
inline constexpr ThemeColor kWarning(&Palette::warning);
inline constexpr ThemeColor kBad(&Palette::bad);
inline constexpr ThemeColor kDim(&Palette::dim);
inline constexpr ThemeColor kMessageGround(&Palette::message);

}  // namespace palpate::view
