#include "client/view/app/interface.h"

// Must come before headers that include OpenGL's own header.
#include <epoxy/gl.h>

#include <backends/imgui_impl_opengl3.h>
#include <imgui.h>

#include <algorithm>
#include <filesystem>

#include "client/view/app/layout.h"
#include "client/view/app/panels.h"
#include "client/view/render/frame_target.h"
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
  ImGui::StyleColorsDark();
  ImGuiStyle& style = ImGui::GetStyle();
  style.WindowBorderSize = 0.0f;
  style.FrameRounding = 3.0f;
  style.GrabRounding = 3.0f;
  style.WindowPadding = {10.0f, 8.0f};
  style.ItemSpacing = {8.0f, 5.0f};
  style.ScrollbarSize = 11.0f;
  style.Colors[ImGuiCol_WindowBg] = {0.11f, 0.12f, 0.14f, 1.0f};
  style.Colors[ImGuiCol_Header] = {0.20f, 0.24f, 0.30f, 1.0f};
  style.ScaleAllSizes(scale);
}

void DrawPanels(Viewer& viewer, const Layout& layout, float scale) {
  DrawTopBar(viewer, layout.top, scale);
  DrawStateBar(viewer, layout.state, scale);
  DrawView(viewer, layout.view, scale);
  if (viewer.state().panels_shown) {
    DrawLeftPanels(viewer, layout.left, scale);
    DrawRightPanels(viewer, layout.right, scale);
  }
  if (viewer.feed().series()) DrawSeriesBar(viewer, layout.series);
  if (layout.slices.size.y > 0.0f) DrawSlices(viewer, layout.slices);
  DrawHelp(viewer, scale);
  DrawConnectDialog(viewer, scale);
}

}  // namespace

Interface::Interface(float scale) : scale_(scale) {
  IMGUI_CHECKVERSION();
  ImGui::CreateContext();
  // The layout is fixed, so there is nothing to store.
  ImGui::GetIO().IniFilename = nullptr;
  LoadFont(scale);
  SetStyle(scale);
  if (!ImGui_ImplOpenGL3_Init("#version 430")) {
    ImGui::DestroyContext();
    throw Error(ErrorKind::kUnavailable, "the panels cannot be drawn with this OpenGL");
  }
}

Interface::~Interface() {
  ImGui_ImplOpenGL3_Shutdown();
  ImGui::DestroyContext();
}

void Interface::DrawFrame(Viewer& viewer, const std::vector<KeyPress>& keys,
                          const ImageSize& pixels, unsigned framebuffer) {
  ImGui_ImplOpenGL3_NewFrame();
  ImGui::NewFrame();
  TakeKeys(viewer, keys);
  const ViewState& state = viewer.state();
  const Layout layout = LayOut(ImGui::GetIO().DisplaySize, scale_,
                               {.panels = state.panels_shown,
                                .series = viewer.feed().series().has_value(),
                                .slices = state.slices_shown});
  view_pixels_ = PixelsOf(layout.view.size);
  DrawPanels(viewer, layout, scale_);
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

Image ReadPixels(const ImageSize& size) { return {.size = size, .rgba = ReadRows(size)}; }

}  // namespace palpate::view
