#include "client/view/panels/input.h"

#include <cmath>

#include "client/view/panels/overlays.h"
#include "client/view/panels/slice_pane.h"
#include "client/view/viewer/tools.h"

namespace palpate::view {
namespace {

constexpr double kOrbit_deg_per_px = 0.4;
constexpr double kZoomPerStep = 1.15;

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
  if (viewer.hand().is_carving()) return viewer.Say("what was carved is still coming: once more");
  // Edits of a stroke that is undone would otherwise go on under its number.
  viewer.stroke().BreakOff();
  viewer.brush().End();
  viewer.held().LetGo();
  if (const std::string problem = viewer.actions().Go(forward); !problem.empty()) {
    viewer.Say(problem);
  }
}

}  // namespace

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
