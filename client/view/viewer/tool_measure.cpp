#include "client/view/viewer/tool_measure.h"

#include <imgui.h>

#include "client/view/drawing/camera.h"
#include "client/view/viewer/tool.h"

namespace palpate::view {
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
