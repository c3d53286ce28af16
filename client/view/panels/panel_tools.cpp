// The bars above and below the view: tools and time series.
#include <array>

#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

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

void ToggleSide(Preferences& preferences, Side side, bool shown) {
  const bool left = side == Side::kLeft;
  if (ImGui::ArrowButton(left ? "left side" : "right side",
                         left == shown ? ImGuiDir_Left : ImGuiDir_Right)) {
    (left ? preferences.left_shown : preferences.right_shown) = !shown;
    // Where there is room for one side only, the shown one has it.
    if (!shown) preferences.narrow_side = side;
  }
  Tip(shown ? "hide this side (P hides both)" : "show this side (P shows both)");
}

}  // namespace

std::string WhyNot(const Viewer& viewer, Tool tool) {
  if (tool == Tool::kHand) return WhyNot(viewer, client::Role::kOperator);
  return tool == Tool::kBrush ? WhyNot(viewer, client::Role::kEditor) : "";
}

void DrawToolBar(Viewer& viewer, const Layout& layout, float scale) {
  // A role may become less.
  if (!WhyNot(viewer, viewer.state().tool).empty()) viewer.state().tool = Tool::kTurn;
  const Area& area = layout.tools;
  const float gap = 6.0f * scale;
  BeginPanel("tools", area, ImGuiWindowFlags_NoScrollWithMouse);
  const float y = 0.5f * (area.size.y - ImGui::GetFrameHeight());
  ImGui::SetCursorPos({gap, y});
  ToggleSide(viewer.preferences(), Side::kLeft, layout.left.size.x > 0.0f);
  float width = 7.0f * ImGui::GetFrameHeight();
  for (const ToolButton& button : kTools) width += ButtonWidth(button.label) + gap;
  for (const ToolButton& button : kTools) {
    ImGui::SameLine(0.0f, gap);
    const char* label = width < area.size.x ? button.label : button.narrow;
    const std::string why = WhyNot(viewer, button.tool);
    ImGui::BeginDisabled(!why.empty());
    if (ToggleButton(label, viewer.state().tool == button.tool)) viewer.state().tool = button.tool;
    ImGui::EndDisabled();
    Tip(why.empty() ? button.tip : why.c_str());
  }
  const char* four = "2 \xC3\x97 2";
  bool& in_four = viewer.preferences().four_panes;
  ImGui::SetCursorPos({area.size.x - ImGui::GetFrameHeight() - ButtonWidth(four) - 2.0f * gap, y});
  if (ToggleButton(four, in_four)) {
    in_four = !in_four;
    viewer.state().filling_slice.reset();
    viewer.state().slices_shown = true;
  }
  Tip("the view and three slices as four equal panes, or the slices in a row below");
  ImGui::SetCursorPos({area.size.x - ImGui::GetFrameHeight() - gap, y});
  ToggleSide(viewer.preferences(), Side::kRight, layout.right.size.x > 0.0f);
  ImGui::End();
}

void DrawSeriesBar(Viewer& viewer, const Area& area) {
  LiveFeed& feed = viewer.feed();
  if (!feed.series()) return;
  client::SeriesState series = *feed.series();
  BeginPanel("series", area);
  ImGui::BeginDisabled(!WhyNot(viewer, client::Role::kEditor).empty());
  if (ImGui::Button(series.playing ? "Pause" : "Play",
                    {ImGui::CalcTextSize("Pause").x + 16.0f, 0.0f})) {
    feed.ControlSeries({.playing = !series.playing});
  }
  Tip("the time series, for everyone");
  ImGui::SameLine();
  const double last = series.frames > 0 ? static_cast<double>(series.frames - 1) : 0.0;
  ImGui::SetNextItemWidth(0.34f * area.size.x);
  // Counted from 0, as in other clients: the last frame is one less than the number of frames.
  const std::string format = "at %.1f of 0 to " + std::to_string(static_cast<int>(last));
  if (HeldSlider(viewer, "##position", series.position_frames, 0.0, last, format.c_str())) {
    feed.ControlSeries({.position_frames = series.position_frames});
  }
  Tip("the frame that is shown and felt");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(0.16f * area.size.x);
  if (HeldSlider(viewer, "##rate", series.rate_hz, -30.0, 30.0, "%.1f /s")) {
    feed.ControlSeries({.rate_hz = series.rate_hz});
  }
  Tip("frames per second, negative backwards");
  ImGui::SameLine();
  if (HeldCheckbox(viewer, "Loop", series.loop)) feed.ControlSeries({.loop = series.loop});
  Tip("begin anew after the last frame");
  ImGui::SameLine();
  if (HeldCheckbox(viewer, "Blend", series.interpolate)) {
    feed.ControlSeries({.interpolate = series.interpolate});
  }
  Tip("interpolate between frames");
  ImGui::EndDisabled();
  SharedSign(viewer, "series");
  ImGui::End();
}

}  // namespace palpate::view
