#include "client/view/viewer/theme.h"

#include <array>

namespace palpate::view {
namespace {

const Palette kDarkPalette = {
    .ground = {0.11f, 0.12f, 0.14f, 1.0f},
    .field = {0.17f, 0.20f, 0.25f, 1.0f},
    .histogram = {0.08f, 0.09f, 0.10f, 1.0f},
    .header = {0.20f, 0.24f, 0.30f, 1.0f},
    .popup = {0.09f, 0.10f, 0.12f, 1.0f},
    .message = {0.06f, 0.07f, 0.08f, 0.86f},
    .button = {0.17f, 0.31f, 0.475f, 1.0f},
    .hovered = {0.22f, 0.40f, 0.60f, 1.0f},
    .active = {0.10f, 0.42f, 0.72f, 1.0f},
    .text = {1.0f, 1.0f, 1.0f, 1.0f},
    .dim = {0.68f, 0.72f, 0.78f, 1.0f},
    .good = {0.35f, 0.80f, 0.45f, 1.0f},
    .warning = {1.00f, 0.72f, 0.25f, 1.0f},
    .bad = {1.00f, 0.55f, 0.50f, 1.0f},
    .suggestion = {0.55f, 0.75f, 1.00f, 1.0f},
    .isovalue = {1.00f, 0.92f, 0.47f, 1.0f},
    .material = {0.78f, 0.71f, 0.59f, 1.0f},
    .other_bars = {0.36f, 0.40f, 0.46f, 1.0f},
    .line = {0.75f, 0.80f, 0.86f, 1.0f},
};

const Palette kLightPalette = {
    .ground = {0.95f, 0.95f, 0.96f, 1.0f},
    .field = {0.87f, 0.88f, 0.90f, 1.0f},
    .histogram = {1.0f, 1.0f, 1.0f, 1.0f},
    .header = {0.80f, 0.84f, 0.90f, 1.0f},
    .popup = {1.00f, 1.00f, 1.00f, 1.0f},
    .message = {1.00f, 1.00f, 1.00f, 0.90f},
    .button = {0.70f, 0.80f, 0.93f, 1.0f},
    .hovered = {0.58f, 0.74f, 0.94f, 1.0f},
    .active = {0.45f, 0.68f, 0.96f, 1.0f},
    .text = {0.05f, 0.06f, 0.08f, 1.0f},
    .dim = {0.27f, 0.30f, 0.34f, 1.0f},
    .good = {0.02f, 0.33f, 0.12f, 1.0f},
    .warning = {0.45f, 0.25f, 0.00f, 1.0f},
    .bad = {0.62f, 0.05f, 0.05f, 1.0f},
    .suggestion = {0.05f, 0.25f, 0.60f, 1.0f},
    .isovalue = {0.75f, 0.35f, 0.00f, 1.0f},
    .material = {0.62f, 0.52f, 0.38f, 1.0f},
    .other_bars = {0.68f, 0.71f, 0.75f, 1.0f},
    .line = {0.15f, 0.25f, 0.40f, 1.0f},
};

Theme g_theme = Theme::kDark;

struct Use {
  ImGuiCol color;
  ImVec4 Palette::*of;
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

const Palette& PaletteOf(Theme theme) {
  return theme == Theme::kLight ? kLightPalette : kDarkPalette;
}

void UseTheme(Theme theme) {
  g_theme = theme;
  if (theme == Theme::kLight) {
    ImGui::StyleColorsLight();
  } else {
    ImGui::StyleColorsDark();
  }
  for (const Use& use : kUses) ImGui::GetStyle().Colors[use.color] = PaletteOf(theme).*use.of;
}

ThemeScope::ThemeScope(Theme theme) : before_(g_theme) {
  if (theme != before_) UseTheme(theme);
}

ThemeScope::~ThemeScope() {
  if (g_theme != before_) UseTheme(before_);
}

ThemeColor::operator ImVec4() const { return PaletteOf(g_theme).*member_; }

}  // namespace palpate::view
