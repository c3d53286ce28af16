#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/scene/slice_view.h"

namespace palpate::view {
namespace {

// Moves the cross-hair with the pointer, and along the slice's axis with the wheel. When the user
// has moved the cross-hair, it stops following the proxy.
void MoveCross(Viewer& viewer, const SliceView& view, const ImVec2& min, const Vec3i& lattice) {
  const ImGuiIO& io = ImGui::GetIO();
  ViewState& state = viewer.state();
  Vec3 cross_I = state.cross_I;
  if (ImGui::IsItemActive()) {
    const Eigen::Vector2d p(
        static_cast<double>((io.MousePos.x - min.x) * io.DisplayFramebufferScale.x),
        static_cast<double>((io.MousePos.y - min.y) * io.DisplayFramebufferScale.y));
    cross_I = view.PointAt(p, cross_I[view.axis()]);
  } else if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) {
    cross_I[view.axis()] = std::round(cross_I[view.axis()]) + (io.MouseWheel > 0.0f ? 1.0 : -1.0);
  } else {
    return;
  }
  const Vec3 last_I = lattice.cast<double>() - Vec3::Ones();
  state.cross_I = cross_I.cwiseMax(Vec3::Zero()).cwiseMin(last_I);
  state.cross_follows_proxy = false;
}

void DrawSlice(Viewer& viewer, int axis, const ImVec2& size) {
  static constexpr std::array<const char*, 3> names = {"x", "y", "z"};
  const ViewVolume& volume = viewer.feed().volume();
  const ImVec2 min = ImGui::GetCursorScreenPos();
  ImGui::PushID(axis);
  ImGui::InvisibleButton("slice", size);
  ImGui::PopID();
  const ImageSize pixels = PixelsOf(size);
  const Vec3i& lattice = volume.lattice()->size;
  MoveCross(viewer, SliceView(axis, lattice, VoxelEdges(volume.X_DI()), pixels), min, lattice);
  const ViewState& state = viewer.state();
  const unsigned texture = viewer.Slice({.axis = axis,
                                         .position_voxels = state.cross_I[axis],
                                         .size = pixels,
                                         .surface = state.surface,
                                         .cross_I = state.cross_I});
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddImage(reinterpret_cast<ImTextureID>(static_cast<std::uintptr_t>(texture)), min,
                {min.x + size.x, min.y + size.y}, {0.0f, 1.0f}, {1.0f, 0.0f});
  std::array<char, 32> label{};
  std::snprintf(label.data(), label.size(), "%s = %.1f", names[static_cast<std::size_t>(axis)],
                state.cross_I[axis]);
  const ImVec2 text = ImGui::CalcTextSize(label.data());
  list.AddRectFilled(min, {min.x + text.x + 10.0f, min.y + text.y + 6.0f},
                     IM_COL32(15, 17, 20, 200));
  list.AddText({min.x + 5.0f, min.y + 3.0f}, IM_COL32(255, 235, 120, 255), label.data());
}

}  // namespace

void DrawSlices(Viewer& viewer, const Area& area) {
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, {2.0f, 2.0f});
  BeginPanel("slices", area, ImGuiWindowFlags_NoScrollWithMouse);
  if (viewer.feed().volume().lattice()) {
    const ImVec2 size{std::floor((area.size.x - 4.0f) / 3.0f), area.size.y};
    for (int axis = 0; axis < 3; ++axis) {
      if (axis > 0) ImGui::SameLine();
      DrawSlice(viewer, axis, size);
    }
    ImGui::PopStyleVar(2);
    const char* label = "Follow the proxy (C)";
    const ImVec2 text = ImGui::CalcTextSize(label);
    ImGui::SetCursorPos(
        {area.size.x - text.x - 40.0f, area.size.y - ImGui::GetFrameHeight() - 4.0f});
    bool& follows = viewer.state().cross_follows_proxy;
    if (!follows) ImGui::Checkbox(label, &follows);
  } else {
    ImGui::PopStyleVar(2);
  }
  ImGui::End();
}

}  // namespace palpate::view
