#include "client/view/viewer/tools.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/readout.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {
namespace {

// Depths that differ by more than this many brush radii belong to different surfaces.
constexpr double kJump_radii = 3.0;

constexpr double kGrowthPerStep = 1.1;

bool TakeStroke(Viewer& viewer, const ViewPointer& pointer) {
  PointerStroke& stroke = viewer.stroke();
  const ViewState& state = viewer.state();
  if (!pointer.held) {
    if (stroke.has_pointer()) {
      stroke.Release();
      viewer.brush().End();
    }
    return false;
  }
  if (state.tool != Tool::kBrush) stroke.BreakOff();
  const auto draw = [&viewer](const Vec3& p_D) {
    viewer.brush().Stroke(viewer.state().brush, p_D, viewer.feed().volume(),
                          viewer.feed().commands());
  };
  const PointerStroke::Sink sink = {.draw = draw, .lift = [&viewer] { viewer.brush().Lift(); }};
  if (stroke.has_pointer()) {
    for (const Eigen::Vector2d& at_px : pointer.way_px) stroke.MoveTo(at_px, pointer.size, sink);
    return true;
  }
  if (pointer.clicked && !pointer.shift && state.tool == Tool::kBrush) {
    const double jump_mm =
        kJump_radii * state.brush.radius_mm * DeviceMmPerMm(viewer.feed().volume());
    viewer.brush().End();
    viewer.state().brush.free_above = state.surface.free_above;
    stroke.Begin(viewer.seen_surface(), pointer.at_px, pointer.size, jump_mm, sink);
  }
  return stroke.has_pointer();
}

// During a stroke, the place on the surface that was seen when the stroke began. Otherwise the
// place on the surface of the last picture.
std::optional<Vec3> PlaceOfBrush(Viewer& viewer, const ViewPointer& pointer) {
  if (viewer.state().tool != Tool::kBrush) return std::nullopt;
  if (viewer.stroke().has_pointer()) return viewer.stroke().at_D();
  if (!pointer.hovered) return std::nullopt;
  return viewer.SurfaceAt(pointer.at_px, pointer.size);
}

}  // namespace

void GrowBrush(Viewer& viewer, double steps) {
  ViewState& state = viewer.state();
  if (state.tool != Tool::kBrush) return;
  double& radius_mm = state.brush.radius_mm;
  radius_mm =
      std::clamp(radius_mm * std::pow(kGrowthPerStep, steps), kLeastBrush_mm, kGreatestBrush_mm);
}

// A drag that begins beside the surface turns the view instead.
bool TakeBrush(Viewer& viewer, const ViewPointer& pointer) {
  bool taken = TakeStroke(viewer, pointer);
  if (viewer.state().tool == Tool::kBrush && (pointer.shift || pointer.ctrl) &&
      pointer.wheel_steps != 0.0) {
    GrowBrush(viewer, pointer.wheel_steps);
    taken = true;
  }
  viewer.state().brush_at_D = PlaceOfBrush(viewer, pointer);
  return taken;
}

std::optional<CutScene> CutSceneOf(const Viewer& viewer) {
  const ViewVolume& volume = viewer.feed().volume();
  if (!volume.lattice() || !volume.X_DI()) return std::nullopt;
  return CutScene{.cuts = CutsOf(viewer.state().surface),
                  .X_DI = *volume.X_DI(),
                  .lattice_size = volume.lattice()->size,
                  .pivots_I = viewer.state().cuts.pivots_I,
                  .scale = static_cast<double>(viewer.state().screen_scale)};
}

std::optional<CutHandle> LitHandle(const CutsState& state) {
  return state.drag ? std::optional(state.drag->handle()) : state.under_pointer;
}

bool TakeCutHandles(Viewer& viewer, const ViewPointer& pointer) {
  CutsState& state = viewer.state().cuts;
  state.under_pointer.reset();
  const std::optional<CutScene> scene = CutSceneOf(viewer);
  state.in_use = ImGui::GetFrameCount() - state.panel_frame <= 1;
  if (!scene || !state.in_use || !pointer.held) state.drag.reset();
  if (!scene || !state.in_use) return false;
  const Projection projection(viewer.state().camera, pointer.size);
  if (state.drag) {
    const CutScene moved = state.drag->At(projection, pointer.at_px);
    SetCuts(moved.cuts, viewer.state().surface);
    state.pivots_I = moved.pivots_I;
    return true;
  }
  if (pointer.hovered && !pointer.held) {
    state.under_pointer = HandleAt(*scene, projection, pointer.at_px);
  }
  if (!pointer.clicked || pointer.shift) return false;
  const std::optional<CutHandle> handle = HandleAt(*scene, projection, pointer.at_px);
  if (handle) state.drag.emplace(*handle, *scene, projection, pointer.at_px);
  return handle.has_value();
}

namespace {

// At a scale of 1. A press that moves farther is a drag.
constexpr double kClick_px = 4.0;
constexpr double kNear_px = 8.0;
constexpr int kViewPicture = 3;  // slices are 0 to 2

// An end of a distance that the pointer drags. It stays where there is nothing under the pointer.
void DragEnd(MeasureState& measure, const DistanceEnd& end, const MeasurePointer& pointer) {
  if (end.number >= measure.distances.size()) return;
  if (const auto p_W = pointer.point_W()) measure.distances[end.number].*end.point = *p_W;
}

}  // namespace

bool IsClicked(float scale, ImGuiMouseButton button) {
  const ImGuiIO& io = ImGui::GetIO();
  const float most = static_cast<float>(kClick_px) * scale;
  return ImGui::IsItemHovered() && ImGui::IsMouseReleased(button) &&
         io.MouseDragMaxDistanceSqr[button] < most * most;
}

bool TakeMeasurePointer(Viewer& viewer, const MeasurePointer& pointer) {
  ViewState& state = viewer.state();
  std::optional<MeasurePress>& press = state.measure_press;
  const auto scale = static_cast<double>(state.screen_scale);
  if (state.tool != Tool::kMeasure) {
    press.reset();
    return false;
  }
  if (IsClicked(state.screen_scale, ImGuiMouseButton_Right)) {
    if (const auto number = DistanceAt(state.measure.distances, pointer.at_px, kNear_px * scale,
                                       pointer.pixel_of)) {
      state.measure.Remove(*number);
    } else {
      state.measure.begun_W.reset();
    }
    return true;
  }
  if (pointer.clicked) {
    press = MeasurePress{pointer.picture, pointer.at_px};
    if (!state.measure.begun_W) {
      press->end = EndAt(state.measure.distances, pointer.at_px, kNear_px * scale,
                         pointer.end_of ? pointer.end_of : pointer.pixel_of);
    }
  }
  if (!press || press->picture != pointer.picture) return false;
  if (press->end) {
    press->moved |= (pointer.at_px - press->at_px).norm() > kClick_px * scale;
    if (press->moved) DragEnd(state.measure, *press->end, pointer);
    if (!pointer.held) press.reset();
    return true;
  }
  if ((pointer.at_px - press->at_px).norm() > kClick_px * scale) {
    press.reset();
    return false;
  }
  if (pointer.held) return true;
  press.reset();
  if (const auto p_W = pointer.point_W()) {
    state.measure.AddPoint(*p_W);
  } else {
    viewer.Say("no surface is there to measure from");
  }
  return true;
}

bool TakeMeasure(Viewer& viewer, const ViewPointer& pointer) {
  const std::optional<AffineMap> X_DW = viewer.feed().volume().X_DW();
  if (!X_DW || pointer.shift) return false;
  const Projection projection(viewer.state().camera, pointer.size);
  const auto point_W = [&]() -> std::optional<Vec3> {
    const auto p_D = viewer.SurfaceAt(pointer.at_px, pointer.size);
    return p_D ? std::optional(X_DW->Inverse().Apply(*p_D)) : std::nullopt;
  };
  const auto pixel_of = [&](const Vec3& p_W) { return projection.PixelOf(X_DW->Apply(p_W)); };
  return TakeMeasurePointer(viewer, {.picture = kViewPicture,
                                     .at_px = pointer.at_px,
                                     .clicked = pointer.clicked,
                                     .held = pointer.held,
                                     .point_W = point_W,
                                     .pixel_of = pixel_of});
}

}  // namespace palpate::view
