#include "client/view/app/input.h"

#include <cmath>

#include "client/view/app/layout.h"
#include "client/view/app/panels.h"

namespace palpate::view {
namespace {

constexpr double kOrbit_deg_per_px = 0.4;
constexpr double kZoomPerStep = 1.15;

void TakeKey(Viewer& viewer, const KeyPress& press) {
  ViewState& state = viewer.state();
  if (press.ctrl) {
    if (press.key == "o") OpenConnectDialog(viewer);
    if (press.key == "z") UndoEdit(viewer);
    if (press.key == "y") RedoEdit(viewer);
    return;
  }
  if (press.key == "r") viewer.Aim();
  if (press.key == "b") state.brush.on = !state.brush.on;
  if (press.key == "h") state.overlay.haptic_surface = !state.overlay.haptic_surface;
  if (press.key == "v") state.surface.veil.shown = !state.surface.veil.shown;
  if (press.key == "c") state.cross_follows_proxy = !state.cross_follows_proxy;
  if (press.key == "l") state.slices_shown = !state.slices_shown;
  if (press.key == "p") state.panels_shown = !state.panels_shown;
  if (press.key == "f1") state.help_shown = !state.help_shown;
  if (press.key == "s") state.view_picture_wanted = true;
  if (press.key == "f12") state.window_picture_wanted = true;
}

// Depths that differ by more than this many brush radii belong to different surfaces.
constexpr double kJump_radii = 3.0;

// Converts a point of the screen to a pixel of the picture.
Eigen::Vector2d PixelIn(const ImVec2& min, const Eigen::Vector2d& at) {
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  return {(at.x() - static_cast<double>(min.x)) * static_cast<double>(scale.x),
          (at.y() - static_cast<double>(min.y)) * static_cast<double>(scale.y)};
}

Eigen::Vector2d PointerIn(const ImVec2& min) {
  const ImVec2& at = ImGui::GetIO().MousePos;
  return PixelIn(min, {static_cast<double>(at.x), static_cast<double>(at.y)});
}

// The length in D, in mm, of one mm of the volume (W).
double DeviceMmPerMm(const ViewVolume& volume) {
  if (!volume.lattice() || !volume.X_DI()) return 1.0;
  const double det_D = volume.X_DI()->linear.determinant();
  const double det_W = volume.lattice()->X_WI.linear.determinant();
  return std::cbrt(std::abs(det_D / det_W));
}

void BeginStroke(Viewer& viewer, const Eigen::Vector2d& at_px, const ImageSize& size,
                 const PointerStroke::Sink& sink) {
  const double jump_mm =
      kJump_radii * viewer.state().brush.radius_mm * DeviceMmPerMm(viewer.feed().volume());
  viewer.brush().End();
  viewer.stroke().Begin(viewer.seen_surface(), at_px, size, jump_mm, sink);
}

// Returns true while the brush has the pointer. A drag that begins beside the surface turns the
// view instead.
bool Paint(Viewer& viewer, const ImVec2& min, const ImageSize& size) {
  PointerStroke& stroke = viewer.stroke();
  const bool down = ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left);
  if (!down) {
    if (stroke.has_pointer()) {
      stroke.Release();
      viewer.brush().End();
    }
    return false;
  }
  if (!viewer.state().brush.on) stroke.BreakOff();
  const PointerStroke::Sink sink = {.draw =
                                        [&viewer](const Vec3& p_D) {
                                          viewer.brush().Stroke(viewer.state().brush, p_D,
                                                                viewer.feed().volume(),
                                                                viewer.feed().commands());
                                        },
                                    .lift = [&viewer] { viewer.brush().Lift(); }};
  if (stroke.has_pointer()) {
    for (const Eigen::Vector2d& at : viewer.state().pointer_way) {
      stroke.MoveTo(PixelIn(min, at), size, sink);
    }
    return true;
  }
  const bool begins = ImGui::IsItemClicked(ImGuiMouseButton_Left) && !ImGui::GetIO().KeyShift;
  if (begins && viewer.state().brush.on) BeginStroke(viewer, PointerIn(min), size, sink);
  return stroke.has_pointer();
}

}  // namespace

void TakeKeys(Viewer& viewer, const std::vector<KeyPress>& keys) {
  for (const KeyPress& press : keys) {
    if (press.key == "f12" || !ImGui::GetIO().WantTextInput) {
      TakeKey(viewer, press);
    }
  }
}

void TakePointer(Viewer& viewer, const ImVec2& min, const ImVec2& size_on_screen) {
  const ImGuiIO& io = ImGui::GetIO();
  const ImageSize size = PixelsOf(size_on_screen);
  const Eigen::Vector2d pointer_px = PointerIn(min);
  Camera& camera = viewer.state().camera;
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) {
    camera.Zoom(std::pow(kZoomPerStep, static_cast<double>(io.MouseWheel)));
  }
  if (Paint(viewer, min, size)) return;
  if (ImGui::IsItemHovered() && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
    if (const auto p_D = viewer.SurfaceAt(pointer_px.x(), pointer_px.y(), size))
      camera.LookAt(*p_D);
  }
  // The motion to the place where the button was pressed is not part of the drag.
  if (!ImGui::IsItemActive() || ImGui::IsItemActivated()) return;
  const double right_px = static_cast<double>(io.MouseDelta.x);
  const double down_px = static_cast<double>(io.MouseDelta.y);
  if (right_px == 0.0 && down_px == 0.0) return;
  const bool left = ImGui::IsMouseDown(ImGuiMouseButton_Left);
  if (left && !io.KeyShift) {
    camera.Orbit(-kOrbit_deg_per_px * right_px, kOrbit_deg_per_px * down_px);
  } else {
    camera.Pan(right_px * static_cast<double>(io.DisplayFramebufferScale.x),
               down_px * static_cast<double>(io.DisplayFramebufferScale.y), size);
  }
}

void UndoEdit(Viewer& viewer) {
  if (viewer.brush().CanUndo()) {
    viewer.brush().Undo(viewer.feed().commands());
  } else {
    viewer.Say("nothing to undo");
  }
}

void RedoEdit(Viewer& viewer) {
  if (viewer.brush().CanRedo()) {
    viewer.brush().Redo(viewer.feed().commands());
  } else {
    viewer.Say("nothing to redo");
  }
}

}  // namespace palpate::view
