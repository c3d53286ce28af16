#include <array>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

struct ToolButton {
  Tool tool;
  const char* label;
  const char* narrow;  // where there is little room
  const char* tip;
};

constexpr std::array<ToolButton, 4> kTools = {{
    {Tool::kTurn, "Turn", "Turn", "drag to turn the view, right drag to move it, wheel to zoom"},
    {Tool::kHand, "Hand (G)", "Hand", "take the simulated stylus and feel with the mouse"},
    {Tool::kBrush, "Brush (B)", "Brush", "drag on the surface to edit the volume, for everyone"},
    {Tool::kMeasure, "Measure (M)", "Measure",
     "two clicks on the surface or in a slice; a right click on a line removes it"},
}};

// Returns true if it was pressed.
bool Toggle(const char* label, bool on) {
  ImGui::PushStyleColor(ImGuiCol_Button,
                        ImGui::GetStyleColorVec4(on ? ImGuiCol_ButtonActive : ImGuiCol_FrameBg));
  const bool pressed = ImGui::Button(label);
  ImGui::PopStyleColor();
  return pressed;
}

void ToggleSide(Viewer& viewer, Side side, bool shown) {
  const bool left = side == Side::kLeft;
  if (ImGui::ArrowButton(left ? "left side" : "right side",
                         left == shown ? ImGuiDir_Left : ImGuiDir_Right)) {
    ShowSide(viewer.preferences(), side, !shown);
  }
  Tip(shown ? "hide this side (P hides both)" : "show this side (P shows both)");
}

}  // namespace

void ShowSide(Preferences& preferences, Side side, bool shown) {
  (side == Side::kLeft ? preferences.left_shown : preferences.right_shown) = shown;
  if (shown) preferences.narrow_side = side;
}

std::string WhyNot(const Viewer& viewer, Tool tool) {
  if (tool == Tool::kHand) return WhyNot(viewer, client::Role::kOperator);
  return tool == Tool::kBrush ? WhyNot(viewer, client::Role::kEditor) : "";
}

void DrawToolBar(Viewer& viewer, const Layout& layout, float scale) {
  // A role may become less.
  if (!WhyNot(viewer, viewer.state().tool).empty()) viewer.state().tool = Tool::kTurn;
  const Area& area = layout.tools;
  const float gap = 6.0f * scale;
  BeginPanel("tools", area, ImGuiWindowFlags_NoScrollbar | ImGuiWindowFlags_NoScrollWithMouse);
  const float y = 0.5f * (area.size.y - ImGui::GetFrameHeight());
  ImGui::SetCursorPos({gap, y});
  ToggleSide(viewer, Side::kLeft, layout.left.size.x > 0.0f);
  float width = 7.0f * ImGui::GetFrameHeight();
  for (const ToolButton& button : kTools) width += ButtonWidth(button.label) + gap;
  for (const ToolButton& button : kTools) {
    ImGui::SameLine(0.0f, gap);
    const char* label = width < area.size.x ? button.label : button.narrow;
    const std::string why = WhyNot(viewer, button.tool);
    ImGui::BeginDisabled(!why.empty());
    if (Toggle(label, viewer.state().tool == button.tool)) viewer.state().tool = button.tool;
    ImGui::EndDisabled();
    Tip(why.empty() ? button.tip : why.c_str());
  }
  const char* four = "2 \xC3\x97 2";
  bool& in_four = viewer.preferences().four_panes;
  ImGui::SetCursorPos({area.size.x - ImGui::GetFrameHeight() - ButtonWidth(four) - 2.0f * gap, y});
  if (Toggle(four, in_four)) {
    in_four = !in_four;
    viewer.state().filling_slice.reset();
    viewer.state().slices_shown = true;
  }
  Tip("the view and three slices as four equal panes, or the slices in a row below");
  ImGui::SetCursorPos({area.size.x - ImGui::GetFrameHeight() - gap, y});
  ToggleSide(viewer, Side::kRight, layout.right.size.x > 0.0f);
  ImGui::End();
}

}  // namespace palpate::view
