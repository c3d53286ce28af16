#include "client/view/panels/input.h"

#include <imgui_internal.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "client/view/panels/overlays.h"
#include "client/view/panels/panels.h"
#include "client/view/panels/slice_pane.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/tool_measure.h"

namespace palpate::view {
namespace {

constexpr double kOrbit_deg_per_px = 0.4;
constexpr double kZoomPerStep = 1.15;

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

// How the window looks.
void TakeFrameKey(Viewer& viewer, const KeyPress& press) {
  constexpr int kStep_percent = 10;
  Preferences& preferences = viewer.preferences();
  const bool sides = preferences.left_shown || preferences.right_shown;
  if (press.ctrl) {
    int& percent = preferences.font_percent;
    // Plus is printed on the key of = on many keyboards.
    if (press.key == "+" || press.key == "=") percent += kStep_percent;
    if (press.key == "-") percent -= kStep_percent;
    if (press.key == "0") percent = 100;
    percent = std::clamp(percent, kLeastFont_percent, kMostFont_percent);
    return;
  }
  if (press.key == "p") preferences.left_shown = preferences.right_shown = !sides;
  if (press.key == "d") {
    preferences.plots_shown =
        !ShowsPlots(preferences, ImGui::GetIO().DisplaySize.y, viewer.state().screen_scale);
  }
  if (press.key == "t") {
    preferences.theme = preferences.theme == Theme::kDark ? Theme::kLight : Theme::kDark;
  }
  if (press.key == "f6") FocusNextPart();
}

void TakeKey(Viewer& viewer, const KeyPress& press) {
  ViewState& state = viewer.state();
  TakeFrameKey(viewer, press);
  if (press.ctrl) {
    if (press.key == "o") viewer.files().Choose(DialogKind::kOpenFile);
    if (press.key == "k") OpenConnectDialog(viewer);
    if (press.key == "s") viewer.files().BeginSave();
    if (press.key == "z") UndoEdit(viewer);
    if (press.key == "y") RedoEdit(viewer);
    return;
  }
  if (press.key == "r") viewer.Aim();
  if (press.key == "g") ToggleTool(viewer, Tool::kHand);
  if (press.key == "b") ToggleTool(viewer, Tool::kBrush);
  if (press.key == "m") ToggleTool(viewer, Tool::kMeasure);
  // Many keyboards have no key of their own for brackets.
  if (press.key == "[" || press.key == ",") GrowBrush(viewer, -1.0);
  if (press.key == "]" || press.key == ".") GrowBrush(viewer, 1.0);
  if (press.key == "h") state.overlay.haptic_surface = !state.overlay.haptic_surface;
  if (press.key == "v") state.surface.veil.shown = !state.surface.veil.shown;
  if (press.key == "delete") state.measure.RemoveLast();
  if (press.key.size() == 1 && press.key >= "1" && press.key <= "6")
    LookFromKey(viewer, press.key[0] - '0');
  if (press.key == "+" || press.key == "=") ZoomPointedSlice(viewer, 1.25);
  if (press.key == "-") ZoomPointedSlice(viewer, 0.8);
  if (press.key == "c") state.cross_follows_proxy = !state.cross_follows_proxy;
  if (press.key == "l") state.slices_shown = !state.slices_shown;
  if (press.key == "f1") state.help_shown = !state.help_shown;
  if (press.key == "k") PutMarker(viewer);
  if (press.key == "s") state.view_picture_wanted = true;
  if (press.key == "f12") state.window_picture_wanted = true;
}

ViewPointer PointerOf(const Viewer& viewer, const ImVec2& min, const ImageSize& size) {
  const ImGuiIO& io = ImGui::GetIO();
  ViewPointer pointer{
      .size = size,
      .at_px = PointerIn(min),
      .way_px = {},
      .hovered = ImGui::IsItemHovered(),
      .clicked = ImGui::IsItemClicked(ImGuiMouseButton_Left),
      .held = ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left),
      .shift = io.KeyShift,
      .ctrl = io.KeyCtrl,
      .wheel_steps = ImGui::IsItemHovered() ? static_cast<double>(io.MouseWheel) : 0.0};
  for (const Eigen::Vector2d& at : viewer.state().pointer_way) {
    pointer.way_px.push_back(PixelIn(min, at));
  }
  return pointer;
}

// Undoes or redoes (`forward`) the user's last action.
void Go(Viewer& viewer, bool forward) {
  // Edits of a stroke that is undone would otherwise go on under its number.
  viewer.stroke().BreakOff();
  viewer.brush().End();
  viewer.held().LetGo();
  if (const std::string problem = viewer.actions().Go(forward); !problem.empty()) {
    viewer.Say(problem);
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
  return viewer.files().has_question() ? Open::kQuestion : Open::kNothing;
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
  }
}

}  // namespace

void TakeEscape(Viewer& viewer) {
  if (viewer.state().escape.Press(OpenNow(viewer), EscapeRule::Clock::now())) {
    viewer.feed().StopForces();
  }
}

void TakeKeys(Viewer& viewer, const std::vector<KeyPress>& keys) {
  Close(viewer, viewer.state().escape.TakeClosing());
  for (const KeyPress& press : keys) {
    if (press.key == "f12" || !ImGui::GetIO().WantTextInput) TakeKey(viewer, press);
  }
}

void TakePointer(Viewer& viewer, const ImVec2& min, const ImVec2& size_on_screen) {
  const ImGuiIO& io = ImGui::GetIO();
  const ImageSize size = PixelsOf(size_on_screen);
  ViewPointer pointer = PointerOf(viewer, min, size);
  const bool cuts = TakeCutHandles(viewer, pointer);
  // The tools let go of it.
  if (cuts) pointer = {.size = size, .at_px = pointer.at_px, .way_px = {}};
  // All of them, whichever has the pointer.
  const bool hand = viewer.hand().Take(viewer, pointer);
  const bool brush = TakeBrush(viewer, pointer);
  const bool measure = TakeMeasure(viewer, pointer);
  if (cuts || hand || brush || measure) return;
  Camera& camera = viewer.state().camera;
  if (pointer.wheel_steps != 0.0) camera.Zoom(std::pow(kZoomPerStep, pointer.wheel_steps));
  if (ImGui::IsItemHovered() && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
    if (const auto p_D = viewer.SurfaceAt(pointer.at_px, size)) camera.LookAt(*p_D);
  }
  if (viewer.state().tool == Tool::kTurn && IsClicked(viewer.state().screen_scale)) {
    // The slices go to the point, and stay there.
    const auto& X_DI = viewer.feed().volume().X_DI();
    const auto p_D = viewer.SurfaceAt(pointer.at_px, size);
    if (p_D && X_DI) MoveCross(viewer, X_DI->Inverse().Apply(*p_D));
  }
  // The motion to the place where the button was pressed is not part of the drag.
  if (!ImGui::IsItemActive() || ImGui::IsItemActivated()) return;
  const double right_px = io.MouseDelta.x;
  const double down_px = io.MouseDelta.y;
  if (right_px == 0.0 && down_px == 0.0) return;
  // The hand has the left button, so the right one turns.
  const bool leads = viewer.state().tool == Tool::kHand;
  const bool turns = ImGui::IsMouseDown(leads ? ImGuiMouseButton_Right : ImGuiMouseButton_Left);
  if (turns && !io.KeyShift) {
    camera.Orbit(-kOrbit_deg_per_px * right_px, kOrbit_deg_per_px * down_px);
  } else {
    const ImVec2& scale = io.DisplayFramebufferScale;
    camera.Pan(right_px * scale.x, down_px * scale.y, size);
  }
}

void UndoEdit(Viewer& viewer) { Go(viewer, false); }

void RedoEdit(Viewer& viewer) { Go(viewer, true); }

}  // namespace palpate::view
