#include <array>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"

namespace palpate::view {
namespace {

struct Line {
  const char* what;
  const char* does;
};

constexpr std::array<Line, 25> kLines = {{
    {"Esc", "emergency stop: no forces until they are enabled again"},
    {"Esc in a text field", "restore the text"},
    {"", ""},
    {"left drag", "turn"},
    {"right drag, shift + left drag", "move"},
    {"wheel", "closer, farther"},
    {"double click", "look at that point"},
    {"R", "back to the first view"},
    {"", ""},
    {"B", "brush on or off; then left drag on the surface edits"},
    {"ctrl+Z, ctrl+Y", "undo and redo a stroke"},
    {"V", "veil: a second, translucent isosurface"},
    {"H", "wireframe of the surface that is felt, near the proxy"},
    {"C", "slices follow the proxy, or stay"},
    {"click, wheel on a slice", "move the cross-hair"},
    {"L, P", "slices, panels on or off"},
    {"ctrl+O", "connect to a palpated, or disconnect"},
    {"", ""},
    {"S", "picture of the view, as a file"},
    {"F12", "picture of the window, as a file"},
    {"F1", "this help"},
    {"", ""},
    {"ctrl+click on a number", "type it"},
    {"drag on the histogram", "isovalue, for everyone"},
    {"", "Feel and isovalue are palpated's; the look is yours alone."},
}};

}  // namespace

void DrawHelp(Viewer& viewer, float scale) {
  bool& shown = viewer.state().help_shown;
  if (!shown) return;
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  ImGui::SetNextWindowPos({0.5f * screen.x, 0.5f * screen.y}, ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::Begin("Help", &shown,
               ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoSavedSettings);
  for (const Line& line : kLines) {
    ImGui::TextColored(kWarning, "%s", line.what);
    ImGui::SameLine(220.0f * scale);
    ImGui::Text("%s", line.does);
  }
  ImGui::End();
}

}  // namespace palpate::view
