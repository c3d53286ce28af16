// The brush's ball in a slice.
#include <cmath>

#include "client/view/app/panels.h"

namespace palpate::view {
namespace {

// The circle in which a slice cuts a ball of this radius around the brush's place.
void DrawCircle(const Vec3& center_I, double radius_mm, const SliceView& view,
                const SignedAxis& across, double position_voxels, const Vec3& voxel_mm,
                const ImVec2& min, ImU32 color) {
  const double aside_mm = (position_voxels - center_I[across.axis]) * voxel_mm[across.axis];
  const double cut_mm = std::sqrt(radius_mm * radius_mm - aside_mm * aside_mm);
  if (!(cut_mm > 0.0)) return;  // also of no number
  const Eigen::Vector2d center_px = view.PixelOf(center_I);
  Vec3 edge_I = center_I;
  const int along = (across.axis + 1) % 3;
  edge_I[along] += cut_mm / voxel_mm[along];
  const double radius_px = (view.PixelOf(edge_I) - center_px).norm();
  const ImVec2 scale = ImGui::GetIO().DisplayFramebufferScale;
  ImGui::GetWindowDrawList()->AddCircle({min.x + static_cast<float>(center_px.x()) / scale.x,
                                         min.y + static_cast<float>(center_px.y()) / scale.y},
                                        static_cast<float>(radius_px) / scale.x, color, 48, 1.5f);
}

}  // namespace

void DrawBrushInSlice(const Viewer& viewer, const SliceView& view, const SignedAxis& across,
                      const ImVec2& min) {
  const ViewState& state = viewer.state();
  const ViewVolume& volume = viewer.feed().volume();
  if (!state.brush_at_D || !volume.X_DI() || !volume.lattice()) return;
  const Vec3 center_I = volume.X_DI()->Inverse().Apply(*state.brush_at_D);
  const Vec3 voxel_mm = volume.lattice()->X_WI.linear.colwise().norm();
  const double position_voxels = state.cross_I[across.axis];
  DrawCircle(center_I, state.brush.radius_mm, view, across, position_voxels, voxel_mm, min,
             IM_COL32(170, 240, 255, 255));
  if (state.brush.falloff_mm <= 0.0) return;
  DrawCircle(center_I, state.brush.radius_mm + state.brush.falloff_mm, view, across,
             position_voxels, voxel_mm, min, IM_COL32(170, 240, 255, 110));
}

}  // namespace palpate::view
