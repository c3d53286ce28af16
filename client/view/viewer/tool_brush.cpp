#include <algorithm>
#include <cmath>

#include "client/view/drawing/readout.h"
#include "client/view/viewer/tool.h"
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

}  // namespace palpate::view
