#include "client/view/panels/interface.h"

// Must come before headers that include OpenGL's own header.
#include <epoxy/gl.h>

#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>
#include <imgui_internal.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>

#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/theme.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

constexpr float kFontPixels = 15.0f;
// From Debian's fonts-dejavu-core. If it is missing, Dear ImGui's own font is used.
constexpr const char* kFont = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";

void LoadFont(float scale) {
  ImFontAtlas& fonts = *ImGui::GetIO().Fonts;
  // Beyond Latin-1, only the characters of the panels: minus, Greek, times.
  static const ImWchar ranges[] = {0x20, 0xff, 0x391, 0x3c9, 0x2013, 0x2026, 0x2212, 0x2212, 0};
  if (std::filesystem::exists(kFont)) {
    fonts.AddFontFromFileTTF(kFont, kFontPixels * scale, nullptr, ranges);
    return;
  }
  ImFontConfig config;
  config.SizePixels = 13.0f * scale;
  fonts.AddFontDefault(&config);
}

void SetStyle(float scale) {
  ImGuiStyle style;
  style.WindowBorderSize = 0.0f;
  style.FrameRounding = 3.0f;
  style.GrabRounding = 3.0f;
  style.WindowPadding = {10.0f, 8.0f};
  style.ItemSpacing = {8.0f, 5.0f};
  style.ScrollbarSize = 11.0f;
  style.ScaleAllSizes(scale);
  ImGui::GetStyle() = style;
}

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
  for (const char* heading : {kToolHeading, kFeelHeading, kDeviceHeading})
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

// The tabs Surface, Look, Cut, Edit.
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

// The headings Tool, Feel, Device, Session.
void DrawRightPanels(Viewer& viewer, const Area& area) {
  BeginPanel("right", area);
  OpenForRole(viewer);
  ImGui::PushItemWidth(0.5f * ImGui::GetContentRegionAvail().x);
  ToolPanel(viewer);
  FeelPanel(viewer);
  DevicePanel(viewer);
  SessionPanel(viewer);
  ImGui::PopItemWidth();
  ImGui::End();
}

// The edges that drag the widths of the sides.
void DrawEdges(Viewer& viewer, const Layout& layout, float scale) {
  Preferences& preferences = viewer.preferences();
  DragEdge("left edge", layout.left_edge, layout.left.size.x, 1.0f, scale,
           preferences.left_width_px);
  DragEdge("right edge", layout.right_edge, layout.right.size.x, -1.0f, scale,
           preferences.right_width_px);
}

// Dialogs over the panels, and the two bars over the dialogs. Menus hang from the upper bar.
void DrawOver(Viewer& viewer, const Layout& layout, float scale) {
  DrawHelp(viewer, layout, scale);
  DrawConnectDialog(viewer, scale);
  DrawPathForm(viewer, scale);
  if (!ImGui::GetCurrentContext()->OpenPopupStack.empty()) return;
  for (const char* bar : {"top", "state"}) {
    if (ImGuiWindow* window = ImGui::FindWindowByName(bar)) {
      ImGui::BringWindowToDisplayFront(window);
    }
  }
}

// The slice that fills the view's place. None also while no slice is drawn.
std::optional<int> FillingSlice(const Viewer& viewer, const Layout& layout) {
  const bool drawn = layout.slices.size.y > 0.0f && viewer.feed().volume().lattice();
  return drawn ? viewer.state().filling_slice : std::nullopt;
}

// In a slice's place while that slice fills the view's.
const Area& PlaceOfView(const std::optional<int>& filling, const Layout& layout,
                        const SliceStrip& strip) {
  return filling ? strip.slices[static_cast<std::size_t>(*filling)] : layout.view;
}

void DrawPanels(Viewer& viewer, const Layout& layout, float scale) {
  FollowSession(viewer);
  DrawTopBar(viewer, layout.top, scale);
  if (viewer.files().PageShown()) {
    const ImVec2 screen = ImGui::GetIO().DisplaySize;
    const float top = layout.top.size.y;
    DrawStartPage(viewer, {{0.0f, top}, {screen.x, screen.y - top}}, scale);
    DrawOver(viewer, layout, scale);
    return;
  }
  DrawStateBar(viewer, layout.state, scale);
  DrawToolBar(viewer, layout, scale);
  const SliceStrip strip = LayOutSlices(layout, scale);
  const std::optional<int> filling = FillingSlice(viewer, layout);
  // In a slice's place there is no room for the legend.
  DrawView(viewer, PlaceOfView(filling, layout, strip), layout, !filling && !layout.in_four, scale);
  if (layout.notice.size.y > 0.0f) DrawNotice(viewer, layout.notice, scale);
  DrawFileCard(viewer, layout.view, scale);
  if (layout.left.size.x > 0.0f) DrawLeftPanels(viewer, layout.left);
  if (layout.right.size.x > 0.0f) DrawRightPanels(viewer, layout.right);
  DrawEdges(viewer, layout, scale);
  if (layout.series.size.y > 0.0f) DrawSeriesBar(viewer, layout.series);
  if (layout.slices.size.y > 0.0f) DrawSlices(viewer, strip, layout.view, scale);
  DrawPlots(viewer, layout, scale);
  DrawOver(viewer, layout, scale);
  DrawRefusal(viewer, layout, scale);
}

}  // namespace

Interface::Interface(float screen_scale) : screen_scale_(screen_scale) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  // Dear ImGui has nothing to store: see Preferences.
  ImGui::GetIO().IniFilename = nullptr;
  LoadFont(screen_scale);
  SetStyle(screen_scale);
  UseTheme(theme_);
  if (!ImGui_ImplOpenGL3_Init("#version 430")) {
    ImGui::DestroyContext();
    throw Error(ErrorKind::kUnavailable, "the panels cannot be drawn with this OpenGL");
  }
}

Interface::~Interface() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui::DestroyContext();
}

void Interface::TakeLook(const Preferences& wanted) {
  const bool resizes = wanted.font_percent != font_percent_;
  const bool recolors = resizes || wanted.theme != theme_;
  font_percent_ = wanted.font_percent;
  theme_ = wanted.theme;
  if (resizes) {
    ImGui::GetIO().Fonts->Clear();
    LoadFont(Scale());
    ImGui_ImplOpenGL3_DestroyFontsTexture();
    ImGui_ImplOpenGL3_CreateFontsTexture();
    SetStyle(Scale());
  }
  if (recolors) UseTheme(theme_);
}

void Interface::DrawFrame(Viewer& viewer, const std::vector<KeyPress>& keys,
                          const ImageSize& pixels, unsigned framebuffer) {
  TakeLook(viewer.preferences());
  const float scale = Scale();
  viewer.state().screen_scale = scale;
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  TakeKeys(viewer, keys);
  const Layout layout =
      LayOut(ImGui::GetIO().DisplaySize, scale,
             {.preferences = viewer.preferences(),
              .in_four = viewer.preferences().four_panes && !viewer.state().filling_slice,
              .notice = !viewer.files().warnings().empty(),
              .series = viewer.feed().series().has_value(),
              .slices = viewer.state().slices_shown});
  view_pixels_ =
      PixelsOf(PlaceOfView(FillingSlice(viewer, layout), layout, LayOutSlices(layout, scale)).size);
  DrawPanels(viewer, layout, scale);
  viewer.actions().EndFrame(ImGui::IsAnyItemActive());
  ImGui::Render();
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, pixels.width, pixels.height);
  glDisable(GL_SCISSOR_TEST);
  // The panels' background.
  const ImVec4& ground = ImGui::GetStyle().Colors[ImGuiCol_WindowBg];
  glClearColor(ground.x, ground.y, ground.z, 1.0f);
  glClear(GL_COLOR_BUFFER_BIT);
  ImGui_ImplOpenGL3_RenderDrawData(ImGui::GetDrawData());
}

}  // namespace palpate::view
