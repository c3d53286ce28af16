#include <algorithm>
#include <array>

#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

struct Tab {
  LeftTab tab;
  const char* label;
  const char* tip;
  void (*draw)(Viewer& viewer);
};

constexpr std::array<Tab, 4> kTabs = {{
    {LeftTab::kSurface, "Surface", "the surface that is seen and felt", SurfaceTab},
    {LeftTab::kLook, "Look", "colours, the veil and what is drawn over the surface", LookTab},
    {LeftTab::kCut, "Cut", "crop box and clip planes", CutTab},
    {LeftTab::kEdit, "Edit", "brush and filters", EditTab},
}};

// The tabs stay, and what is below them scrolls.
void DrawTab(Viewer& viewer, const Tab& tab) {
  ImGui::BeginChild(tab.label, {0.0f, 0.0f}, false, ImGuiWindowFlags_NavFlattened);
  ImGui::PushItemWidth(0.58f * ImGui::GetContentRegionAvail().x);
  tab.draw(viewer);
  ImGui::PopItemWidth();
  ImGui::EndChild();
}

// Watchers begin with closed headings of what they cannot change; others with open ones.
void OpenForRole(Viewer& viewer) {
  std::optional<client::Role>& opened_for = viewer.state().headings_opened_for;
  const client::Role role = viewer.feed().role();
  const bool is_connected = viewer.feed().connection().state == client::ConnectionState::kConnected;
  if (!is_connected || opened_for == role) return;
  opened_for = role;
  ImGuiStorage& open = *ImGui::GetStateStorage();
  for (const char* heading : {kFeelHeading, kDeviceHeading})
    open.SetInt(ImGui::GetID(heading), role == client::Role::kViewer ? 0 : 1);
}

// A thin area that drags the width of a side. `toward`: 1 if the side grows to the right.
void DragEdge(const char* name, const Area& area, float shown_width, float toward, float scale,
              double& width_px) {
  if (area.size.x <= 0.0f) return;
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  ImGui::PushStyleVar(ImGuiStyleVar_WindowMinSize, {1.0f, 1.0f});
  BeginPanel(name, area, ImGuiWindowFlags_NoScrollWithMouse | ImGuiWindowFlags_NoNav);
  ImGui::PopStyleVar(2);
  ImGui::InvisibleButton("edge", area.size);
  const bool held = ImGui::IsItemActive();
  if (held || ImGui::IsItemHovered()) {
    ImGui::SetMouseCursor(ImGuiMouseCursor_ResizeEW);
    const ImU32 color = ImGui::GetColorU32(held ? ImGuiCol_ButtonActive : ImGuiCol_ButtonHovered);
    ImGui::GetWindowDrawList()->AddRectFilled(area.min, MaxOf(area), color);
  }
  Tip("drag to resize");
  const float moved = toward * ImGui::GetIO().MouseDelta.x;
  // From the width on the screen: the kept one may be wider than the window allows.
  if (held && !ImGui::IsItemActivated() && moved != 0.0f) {
    width_px =
        std::clamp(static_cast<double>((shown_width + moved) / scale), kLeastSide_px, kMostSide_px);
  }
  ImGui::End();
}

}  // namespace

void DrawLeftPanels(Viewer& viewer, const Area& area) {
  BeginPanel("left", area);
  LeftTab& chosen = viewer.preferences().tab;
  bool& is_first = viewer.state().tab_wanted;
  if (ImGui::BeginTabBar("tabs", ImGuiTabBarFlags_FittingPolicyResizeDown)) {
    for (const Tab& tab : kTabs) {
      const bool wanted = is_first && tab.tab == chosen;
      const bool open =
          ImGui::BeginTabItem(tab.label, nullptr, wanted ? ImGuiTabItemFlags_SetSelected : 0);
      Tip(tab.tip);
      if (!open) continue;
      if (!is_first) chosen = tab.tab;
      DrawTab(viewer, tab);
      ImGui::EndTabItem();
    }
    is_first = false;
    ImGui::EndTabBar();
  }
  ImGui::End();
}

void DrawRightPanels(Viewer& viewer, const Area& area) {
  BeginPanel("right", area);
  OpenForRole(viewer);
  ImGui::PushItemWidth(0.5f * ImGui::GetContentRegionAvail().x);
  FeelPanel(viewer);
  DevicePanel(viewer);
  SessionPanel(viewer);
  ImGui::PopItemWidth();
  ImGui::End();
}

void DrawEdges(Viewer& viewer, const Layout& layout, float scale) {
  Preferences& preferences = viewer.preferences();
  DragEdge("left edge", layout.left_edge, layout.left.size.x, 1.0f, scale,
           preferences.left_width_px);
  DragEdge("right edge", layout.right_edge, layout.right.size.x, -1.0f, scale,
           preferences.right_width_px);
}

}  // namespace palpate::view
