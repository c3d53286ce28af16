// The keys: what each does, and the help, which also says what the pointer does. Esc.
#include "client/view/panels/input.h"

#include <imgui_internal.h>

#include <algorithm>
#include <array>

#include "client/view/panels/overlays.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/slice_pane.h"
#include "client/view/panels/widgets.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/tools.h"

namespace palpate::view {
namespace {

// The parts of the screen in the order in which F6 goes through them, by the names of their
// windows.
constexpr std::array<const char*, 6> kParts = {"top",  "state", "tools",
                                               "left", "right", "plots bar"};

void FocusNextPart() {
  const ImGuiWindow* focused = ImGui::GetCurrentContext()->NavWindow;
  const auto is_focused = [focused](const char* name) {
    return focused && focused->RootWindow == ImGui::FindWindowByName(name);
  };
  std::size_t part = std::find_if(kParts.begin(), kParts.end(), is_focused) - kParts.begin();
  for (std::size_t tries = 0; tries < kParts.size(); ++tries) {
    part = part >= kParts.size() - 1 ? 0 : part + 1;
    ImGuiWindow* window = ImGui::FindWindowByName(kParts[part]);
    if (!window || !window->WasActive) continue;
    ImGui::FocusWindow(window);
    ImGui::NavInitWindow(window, true);
    return;
  }
}

void ToggleTool(Viewer& viewer, Tool tool) {
  if (const std::string why = WhyNot(viewer, tool); !why.empty()) {
    viewer.Say(why);
    return;
  }
  Tool& present = viewer.state().tool;
  present = present == tool ? Tool::kTurn : tool;
}

template <Tool tool>
void Toggle(Viewer& viewer) {
  ToggleTool(viewer, tool);
}

// Of the stylus in the hand.
template <int button>
void KeepButton(Viewer& viewer) {
  if (viewer.state().tool == Tool::kHand) viewer.state().hand.kept_buttons ^= 1U << button;
}

// Of the font's size.
template <int percent>
void GrowFont(Viewer& viewer) {
  int& size = viewer.preferences().font_percent;
  size = std::clamp(size + percent, kLeastFont_percent, kMostFont_percent);
}

template <int number>
void Look(Viewer& viewer) {
  LookFromKey(viewer, number);
}

void ToggleSides(Viewer& viewer) {
  Preferences& preferences = viewer.preferences();
  const bool sides = preferences.left_shown || preferences.right_shown;
  preferences.left_shown = preferences.right_shown = !sides;
}

void TogglePlots(Viewer& viewer) {
  Preferences& preferences = viewer.preferences();
  preferences.plots_shown =
      !ShowsPlots(preferences, ImGui::GetIO().DisplaySize.y, viewer.state().screen_scale);
}

void ToggleTheme(Viewer& viewer) {
  Theme& theme = viewer.preferences().theme;
  theme = theme == Theme::kDark ? Theme::kLight : Theme::kDark;
}

void ZoomIn(Viewer& viewer) { ZoomPointedSlice(viewer, 1.25); }

// Turns a switch of the view's state.
void Flip(bool& shown) { shown = !shown; }

struct Key {
  const char* name;  // as in KeyPress
  void (*take)(Viewer& viewer);
  bool ctrl = false;
};

// A line of the help, and the keys that do it. Without `does` it is a heading.
struct Line {
  const char* what;
  const char* does;
  std::array<Key, 6> keys{};  // the rest without a name
};

constexpr Line kLines[] = {
    {"Forces", nullptr},
    {"Esc",
     "close what is open, a half distance too; else the emergency stop: no forces until they are "
     "enabled again"},
    {"Esc twice", "the emergency stop, whatever is open"},
    {"View", nullptr},
    {"left drag", "turn"},
    {"right drag, shift + left drag", "move"},
    {"wheel", "closer, farther"},
    {"click on the surface", "the slices go there"},
    {"double click", "look at that point"},
    {"R", "back to the first view", {{{"r", [](Viewer& v) { v.Aim(); }}}}},
    {"1 ... 6, the cube",
     "anterior, posterior, left, right, superior, inferior",
     {{{"1", Look<1>},
       {"2", Look<2>},
       {"3", Look<3>},
       {"4", Look<4>},
       {"5", Look<5>},
       {"6", Look<6>}}}},
    {"V",
     "veil: a second, translucent isosurface",
     {{{"v", [](Viewer& v) { Flip(v.state().surface.veil.shown); }}}}},
    {"drag on a handle", "move or turn what cuts, while Crop and cut is open"},
    {"H",
     "wireframe of the surface that is felt, near the proxy",
     {{{"h", [](Viewer& v) { Flip(v.state().overlay.haptic_surface); }}}}},
    {"Tools", nullptr},
    {"G, B, M",
     "hand, brush, measure; the same key again: turn",
     {{{"g", Toggle<Tool::kHand>}, {"b", Toggle<Tool::kBrush>}, {"m", Toggle<Tool::kMeasure>}}}},
    {"hand: left button, wheel",
     "carve, if button 0 carves, else deeper; deeper; right drag turns, with shift it moves"},
    {"hand: alt, alt + wheel", "turn the stylus with the pointer, roll it"},
    {"hand: X, Y",
     "hold button 0, button 1 of the stylus; the same key again: let go",
     {{{"x", KeepButton<0>}, {"y", KeepButton<1>}}}},
    // Many keyboards have no key of their own for brackets.
    {"[ and ], comma and point",
     "radius of the brush; also ctrl + wheel",
     {{{"[", [](Viewer& v) { GrowBrush(v, -1.0); }},
       {"]", [](Viewer& v) { GrowBrush(v, 1.0); }},
       {",", [](Viewer& v) { GrowBrush(v, -1.0); }},
       {".", [](Viewer& v) { GrowBrush(v, 1.0); }}}}},
    {"M", "distances: two clicks on the surface or in a slice; drag an end"},
    {"right click, Delete",
     "remove the distance there, the last distance",
     {{{"delete", [](Viewer& v) { v.state().measure.RemoveLast(); }}}}},
    {"ctrl+Z, ctrl+Y",
     "undo and redo what you did: isovalue, feel, cuts, strokes, filters",
     {{{"z", UndoEdit, true}, {"y", RedoEdit, true}}}},
    {"Slices", nullptr},
    {"C",
     "slices follow the stylus, or stay",
     {{{"c", [](Viewer& v) { Flip(v.state().cross_follows_proxy); }}}}},
    {"click, wheel on a slice", "move the cross-hair"},
    // Plus is printed on the key of = on many keyboards.
    {"ctrl+wheel, + and - on a slice",
     "zoom; middle drag or shift + drag moves it",
     {{{"+", ZoomIn}, {"=", ZoomIn}, {"-", [](Viewer& v) { ZoomPointedSlice(v, 0.8); }}}}},
    {"right drag on a slice", "window: across its width, up its level"},
    {"double click on a slice", "as large as the view, and back"},
    {"L", "slices on or off", {{{"l", [](Viewer& v) { Flip(v.state().slices_shown); }}}}},
    {"Session", nullptr},
    {"K", "put a marker into the recording", {{{"k", PutMarker}}}},
    {"Controls", nullptr},
    {"drag on the histogram", "isovalue, for everyone"},
    {"ctrl+click on a number", "type it"},
    {"F6",
     "the next part of the window, for the keyboard",
     {{{"f6", [](Viewer&) { FocusNextPart(); }}}}},
    {"arrows, space, Tab", "go to a control, press or open it, the next number"},
    {"Files", nullptr},
    {"ctrl+O, drop",
     "open a file or folder; File has more",
     {{{"o", [](Viewer& v) { v.files().Choose(DialogKind::kOpenFile); }, true}}}},
    {"ctrl+S",
     "save the volume with its edits",
     {{{"s", [](Viewer& v) { v.files().BeginSave(); }, true}}}},
    {"ctrl+K", "connect to a palpated, or disconnect", {{{"k", OpenConnectDialog, true}}}},
    {"Window", nullptr},
    {"P, D", "side panels, plots on or off", {{{"p", ToggleSides}, {"d", TogglePlots}}}},
    {"T", "dark or light", {{{"t", ToggleTheme}}}},
    {"ctrl + and -, ctrl+0",
     "larger or smaller text, and as it was",
     {{{"+", GrowFont<10>, true},
       {"=", GrowFont<10>, true},
       {"-", GrowFont<-10>, true},
       {"0", [](Viewer& v) { v.preferences().font_percent = 100; }, true}}}},
    {"S, F12",
     "picture of the view, of the window, as a file",
     {{{"s", [](Viewer& v) { v.state().view_picture_wanted = true; }},
       {"f12", [](Viewer& v) { v.state().window_picture_wanted = true; }}}}},
    {"F1", "this help", {{{"f1", [](Viewer& v) { Flip(v.state().help_shown); }}}}},
};

void TakeKey(Viewer& viewer, const KeyPress& press) {
  for (const Line& line : kLines) {
    for (const Key& key : line.keys) {
      if (key.name && key.ctrl == press.ctrl && press.key == key.name) return key.take(viewer);
    }
  }
}

Open OpenNow(Viewer& viewer) {
  const ViewState& state = viewer.state();
  // With the field in it that has the keyboard.
  if (viewer.files().form().shown) return Open::kPathForm;
  if (state.connect.shown) return Open::kConnect;
  // Asks for the field itself: WantTextInput is a frame old.
  const ImGuiID field = ImGui::GetActiveID();
  if (field != 0 && ImGui::GetInputTextState(field)) return Open::kField;
  if (!ImGui::GetCurrentContext()->OpenPopupStack.empty()) return Open::kPopup;
  if (state.help_shown) return Open::kHelp;
  if (viewer.files().has_question() || state.wished_tool) return Open::kQuestion;
  const bool measures = state.tool == Tool::kMeasure && state.measure.begun_W;
  return measures ? Open::kDistance : Open::kNothing;
}

void Close(Viewer& viewer, Open open) {
  switch (open) {
    case Open::kNothing:
    case Open::kField:  // Dear ImGui restores the text and leaves the field
      return;
    case Open::kPopup:
      // All levels. Dear ImGui may have closed some.
      if (!ImGui::GetCurrentContext()->OpenPopupStack.empty()) ImGui::ClosePopupToLevel(0, true);
      return;
    case Open::kPathForm:
      viewer.files().form().shown = false;
      return;
    case Open::kConnect:
      viewer.state().connect.shown = false;
      return;
    case Open::kHelp:
      viewer.state().help_shown = false;
      return;
    case Open::kQuestion:
      viewer.files().Dismiss();
      viewer.state().wished_tool.reset();
      return;
    case Open::kDistance:  // with one end
      viewer.state().measure.begun_W.reset();
  }
}

}  // namespace

void TakeEscape(Viewer& viewer) {
  if (viewer.state().escape.Press(OpenNow(viewer), EscapeRule::Clock::now())) {
    viewer.state().hand.kept_buttons = 0;
    viewer.feed().StopForces();
  }
}

void TakeKeys(Viewer& viewer, const std::vector<KeyPress>& keys) {
  Close(viewer, viewer.state().escape.TakeClosing());
  for (const KeyPress& press : keys) {
    if (press.key == "f12" || !ImGui::GetIO().WantTextInput) TakeKey(viewer, press);
  }
}

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
