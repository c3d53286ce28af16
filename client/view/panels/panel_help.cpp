#include "client/view/panels/panels.h"
#include "client/view/panels/widgets.h"

namespace palpate::view {
namespace {

// A line without `does` is a heading.
struct Line {
  const char* what;
  const char* does;
};

constexpr Line kLines[] = {
    {"Forces", nullptr},
    {"Esc", "close what is open; else the emergency stop: no forces until they are enabled again"},
    {"Esc twice", "the emergency stop, whatever is open"},
    {"View", nullptr},
    {"left drag", "turn"},
    {"right drag, shift + left drag", "move"},
    {"wheel", "closer, farther"},
    {"click on the surface", "the slices go there"},
    {"double click", "look at that point"},
    {"R", "back to the first view"},
    {"1 ... 6, the cube", "anterior, posterior, left, right, superior, inferior"},
    {"V", "veil: a second, translucent isosurface"},
    {"drag on a handle", "move or turn what cuts, while Crop and cut is open"},
    {"H", "wireframe of the surface that is felt, near the proxy"},
    {"Tools", nullptr},
    {"G, B, M", "hand, brush, measure; the same key again: turn"},
    {"hand: left button, wheel", "press harder, deeper; right drag turns, with shift it moves"},
    {"hand: alt, wheel", "turn the stylus with the pointer, roll it"},
    {"[ and ], comma and point", "radius of the brush; also ctrl + wheel"},
    {"M", "distances: two clicks on the surface or in a slice; drag an end"},
    {"right click, Delete", "remove the distance there, the last distance"},
    {"ctrl+Z, ctrl+Y", "undo and redo what you did: isovalue, feel, cuts, strokes, filters"},
    {"Slices", nullptr},
    {"C", "slices follow the stylus, or stay"},
    {"click, wheel on a slice", "move the cross-hair"},
    {"ctrl+wheel, + and - on a slice", "zoom; middle drag or shift + drag moves it"},
    {"right drag on a slice", "window: across its width, up its level"},
    {"double click on a slice", "as large as the view, and back"},
    {"L", "slices on or off"},
    {"Session", nullptr},
    {"K", "put a marker into the recording"},
    {"Controls", nullptr},
    {"drag on the histogram", "isovalue, for everyone"},
    {"ctrl+click on a number", "type it"},
    {"F6", "the next part of the window, for the keyboard"},
    {"arrows, space, Tab", "go to a control, press or open it, the next number"},
    {"Files", nullptr},
    {"ctrl+O, drop", "open a file or folder; File has more"},
    {"ctrl+S", "save the volume with its edits"},
    {"ctrl+K", "connect to a palpated, or disconnect"},
    {"Window", nullptr},
    {"P, D", "side panels, plots on or off"},
    {"T", "dark or light"},
    {"ctrl + and -, ctrl+0", "larger or smaller text, and as it was"},
    {"S, F12", "picture of the view, of the window, as a file"},
    {"F1", "this help"},
};

}  // namespace

void DrawHelp(Viewer& viewer, const Layout& layout, float scale) {
  bool& shown = viewer.state().help_shown;
  if (!shown) return;
  // Below the two bars. Scrolls where the window is low.
  const ImVec2 screen = ImGui::GetIO().DisplaySize;
  const float top = layout.state.min.y + layout.state.size.y;
  ImGui::SetNextWindowPos({0.5f * screen.x, top}, ImGuiCond_Always, {0.5f, 0.0f});
  ImGui::SetNextWindowSizeConstraints({0.0f, 0.0f}, {screen.x, screen.y - top});
  ImGui::Begin("Help", &shown, kDialog);
  for (const Line& line : kLines) {
    if (!line.does) {
      ImGui::Separator();
      ImGui::TextUnformatted(line.what);
      continue;
    }
    ImGui::TextColored(kWarning, "%s", line.what);
    ImGui::SameLine(240.0f * scale);
    ImGui::Text("%s", line.does);
  }
  ImGui::Separator();
  ImGui::TextColored(kDim, "Feel and isovalue are palpated's; the look is yours alone.");
  ImGui::End();
}

}  // namespace palpate::view
