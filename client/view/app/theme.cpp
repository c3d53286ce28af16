#include "client/view/app/theme.h"

namespace palpate::view {
namespace {

Theme g_theme = Theme::kDark;

struct Use {
  ImGuiCol color;
  Rgba Palette::*of;
};

// The others are Dear ImGui's own.
constexpr std::array<Use, 25> kUses = {{
    {ImGuiCol_Text, &Palette::text},
    {ImGuiCol_TextDisabled, &Palette::dim},
    {ImGuiCol_WindowBg, &Palette::ground},
    {ImGuiCol_PopupBg, &Palette::popup},
    {ImGuiCol_FrameBg, &Palette::field},
    {ImGuiCol_FrameBgHovered, &Palette::header},
    {ImGuiCol_FrameBgActive, &Palette::header},
    {ImGuiCol_TitleBg, &Palette::field},
    {ImGuiCol_TitleBgActive, &Palette::header},
    {ImGuiCol_Header, &Palette::header},
    {ImGuiCol_HeaderHovered, &Palette::hovered},
    {ImGuiCol_HeaderActive, &Palette::active},
    {ImGuiCol_Button, &Palette::button},
    {ImGuiCol_ButtonHovered, &Palette::hovered},
    {ImGuiCol_ButtonActive, &Palette::active},
    {ImGuiCol_Tab, &Palette::field},
    {ImGuiCol_TabHovered, &Palette::hovered},
    {ImGuiCol_TabActive, &Palette::button},
    {ImGuiCol_TabUnfocused, &Palette::field},
    {ImGuiCol_TabUnfocusedActive, &Palette::button},
    {ImGuiCol_PlotLines, &Palette::line},
    {ImGuiCol_CheckMark, &Palette::text},
    {ImGuiCol_SliderGrab, &Palette::active},
    {ImGuiCol_SliderGrabActive, &Palette::line},
    {ImGuiCol_NavHighlight, &Palette::isovalue},
}};

}  // namespace

void UseTheme(Theme theme) {
  g_theme = theme;
  if (theme == Theme::kLight) {
    ImGui::StyleColorsLight();
  } else {
    ImGui::StyleColorsDark();
  }
  for (const Use& use : kUses) {
    const Rgba& color = CurrentPalette().*use.of;
    ImGui::GetStyle().Colors[use.color] = {color.r, color.g, color.b, color.a};
  }
}

const Palette& CurrentPalette() { return PaletteOf(g_theme); }

ThemeScope::ThemeScope(Theme theme) : before_(g_theme) {
  if (theme != before_) UseTheme(theme);
}

ThemeScope::~ThemeScope() {
  if (g_theme != before_) UseTheme(before_);
}

}  // namespace palpate::view
