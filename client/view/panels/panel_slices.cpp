#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client/view/drawing/readout.h"
#include "client/view/drawing/value_window.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/slice_pane.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

// Whether the slices follow, and the window as a drag changes it.
void DrawRow(Viewer& viewer, const Area& area) {
  BeginPanel("slices", area, ImGuiWindowFlags_NoScrollWithMouse);
  ViewState& state = viewer.state();
  ImGui::SetCursorPosX(6.0f);
  ImGui::Checkbox("Follow the stylus (C)", &state.cross_follows_proxy);
  Tip("slices and cross-hair go with the stylus; otherwise they stay where they were put");
  ImGui::SameLine(0.0f, 16.0f);
  ImGui::TextColored(kDim, "(?)");
  Tip("wheel: from slice to slice\nctrl+wheel, + and -: zoom\nmiddle drag, shift + drag: move\n"
      "right drag: window (across: width, up: level)\ndouble click: as large as the view, and "
      "back");
  const ValueWindow window =
      ValueWindow::Between(state.surface.window_min, state.surface.window_max);
  const std::string text = fmt::format("level {}, width {}", WindowText(window.level, window.width),
                                       WindowText(window.width, window.width));
  const float x = area.size.x - ImGui::CalcTextSize(text.c_str()).x - 4.0f;
  ImGui::SameLine(0.0f, 16.0f);
  if (ImGui::GetCursorPosX() < x) {
    ImGui::SetCursorPosX(x);
    ImGui::TextColored(kDim, "%s", text.c_str());
  }
  ImGui::End();
}

// The colours of the values in the slices and on cut faces, with a mark at the isovalue.
void DrawColorBar(const Viewer& viewer, const Area& area, float scale) {
  BeginPanel("colour bar", area, ImGuiWindowFlags_NoInputs);
  const SurfaceOptions& surface = viewer.state().surface;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float line = ImGui::GetTextLineHeight();
  const float left = area.min.x + 4.0f * scale, right = left + 12.0f * scale;
  const float top = area.min.y + 1.5f * line, bottom = area.min.y + area.size.y - 0.7f * line;
  const std::string unit = OneLine(viewer.feed().volume().lattice()->unit, 8);
  const ImU32 color = ImGui::GetColorU32(ImGuiCol_Text);
  list.AddText({left, area.min.y}, color, unit.c_str());
  if (bottom <= top) {
    ImGui::End();
    return;
  }
  const std::vector<std::uint8_t> table = ColorTable(surface.color_map);
  constexpr int kSteps = 64;
  for (int step = 0; step < kSteps; ++step) {
    const auto entry = static_cast<std::size_t>(4 * (255 * step / (kSteps - 1)));
    const float height = (bottom - top) / kSteps;
    const float y = bottom - height * static_cast<float>(step);
    list.AddRectFilled({left, y - height}, {right, y},
                       IM_COL32(table[entry], table[entry + 1], table[entry + 2], 255));
  }
  list.AddRect({left, top}, {right, bottom}, IM_COL32(110, 115, 125, 255));
  const auto y_of = [&](double share) {
    return bottom - static_cast<float>(share) * (bottom - top);
  };
  for (const double share : {0.0, 0.5, 1.0}) {
    const double value = std::lerp(surface.window_min, surface.window_max, share);
    list.AddText({right + 3.0f * scale, y_of(share) - 0.5f * line}, color,
                 WindowText(value, surface.window_max - surface.window_min).c_str());
  }
  const double share =
      (surface.isovalue - surface.window_min) / (surface.window_max - surface.window_min);
  if (share >= 0.0 && share <= 1.0) {
    list.AddLine({left - 3.0f * scale, y_of(share)}, {right + 1.0f, y_of(share)},
                 IM_COL32(255, 158, 38, 255), 2.0f);
  }
  ImGui::End();
}

}  // namespace

void DrawSlices(Viewer& viewer, const SliceStrip& strip, const Area& view, float scale) {
  if (!viewer.feed().volume().lattice()) return;
  viewer.state().pointed_slice.reset();
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  DrawRow(viewer, strip.row);
  DrawColorBar(viewer, strip.bar, scale);
  ImGui::PopStyleVar();
  // The pictures are dark in both themes.
  const ThemeScope dark(Theme::kDark);
  for (int world_axis = 0; world_axis < 3; ++world_axis) {
    const bool fills = viewer.state().filling_slice == world_axis;
    DrawSlicePane(viewer, world_axis,
                  fills ? view : strip.slices[static_cast<std::size_t>(world_axis)], scale);
  }
}

}  // namespace palpate::view
