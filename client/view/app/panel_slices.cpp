#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "client/view/app/panels.h"
#include "client/view/app/widgets.h"
#include "client/view/scene/slice_view.h"

namespace palpate::view {
namespace {

constexpr std::array<const char*, 3> kPlanes = {"sagittal", "coronal", "axial"};
constexpr ImU32 kCaption = IM_COL32(255, 235, 120, 255);

// Moves the cross-hair with the pointer, and from slice to slice with the wheel: towards left,
// posterior, superior. When the user has moved the cross-hair, it stops following the proxy.
void MoveCross(Viewer& viewer, const SliceView& view, const SignedAxis& across, const ImVec2& min) {
  const ImGuiIO& io = ImGui::GetIO();
  ViewState& state = viewer.state();
  Vec3 cross_I = state.cross_I;
  double& position = cross_I[across.axis];
  if (ImGui::IsItemActive()) {
    const Eigen::Vector2d p(
        static_cast<double>((io.MousePos.x - min.x) * io.DisplayFramebufferScale.x),
        static_cast<double>((io.MousePos.y - min.y) * io.DisplayFramebufferScale.y));
    cross_I = view.PointAt(p, position);
  } else if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) {
    position = std::round(position) + (io.MouseWheel > 0.0f ? across.sign : -across.sign);
  } else {
    return;
  }
  const Vec3 last_I = viewer.feed().volume().lattice()->size.cast<double>() - Vec3::Ones();
  state.cross_I = cross_I.cwiseMax(Vec3::Zero()).cwiseMin(last_I);
  state.cross_follows_proxy = false;
}

void DrawText(const ImVec2& at, const std::string& text, ImU32 color) {
  const ImVec2 size = ImGui::CalcTextSize(text.c_str());
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled({at.x - 5.0f, at.y - 3.0f}, {at.x + size.x + 5.0f, at.y + size.y + 3.0f},
                     IM_COL32(15, 17, 20, 200));
  list.AddText(at, color, text.c_str());
}

// The letters at the middles of the edges.
void DrawLetters(const SliceAxes& in_world, const ImVec2& min, const ImVec2& size) {
  const auto draw = [&](const SignedAxis& direction, float share_x, float share_y) {
    const std::string letter(1, LetterOf(direction));
    const ImVec2 text = ImGui::CalcTextSize(letter.c_str());
    constexpr float kMargin = 6.0f;
    DrawText({min.x + kMargin + share_x * (size.x - text.x - 2.0f * kMargin),
              min.y + kMargin + share_y * (size.y - text.y - 2.0f * kMargin)},
             letter, IM_COL32(255, 255, 255, 255));
  };
  draw(in_world.right, 1.0f, 0.5f);
  draw(-in_world.right, 0.0f, 0.5f);
  draw(in_world.down, 0.5f, 1.0f);
  draw(-in_world.down, 0.5f, 0.0f);
}

// The plane, and where the cross-hair is across it: in the patient's frame, with a letter or a
// sign, and in voxels of the file.
void DrawCaption(const SliceAxes& in_world, const SignedAxis& across, const ViewState& state,
                 const AffineMap& X_WI, const ImVec2& min) {
  const int axis = in_world.across.axis;
  const double at_mm = X_WI.Apply(state.cross_I)[axis];
  const char letter = LetterOf({axis, at_mm < 0.0 ? -1 : 1});
  const std::string place = state.overlay.letters
                                ? fmt::format("{} {:.1f}", letter, std::abs(at_mm))
                                : fmt::format("{:.1f}", at_mm);
  DrawText({min.x + 5.0f, min.y + 3.0f},
           fmt::format("{}\n{} mm\n{} = {:.1f}", kPlanes[static_cast<std::size_t>(axis)], place,
                       "xyz"[across.axis], state.cross_I[across.axis]),
           kCaption);
}

void DrawSlice(Viewer& viewer, int world_axis, const ImVec2& size) {
  const ViewVolume& volume = viewer.feed().volume();
  const AffineMap& X_WI = volume.lattice()->X_WI;
  const ImVec2 min = ImGui::GetCursorScreenPos();
  ImGui::PushID(world_axis);
  ImGui::InvisibleButton("slice", size);
  ImGui::PopID();
  const ImageSize pixels = PixelsOf(size);
  const ViewState& state = viewer.state();
  const SliceAxes axes = SliceInVolume(world_axis, state.slice_side, NearestAxes(X_WI.linear));
  const SliceView view(axes, volume.lattice()->size, VoxelEdges(volume.X_DI()), pixels);
  MoveCross(viewer, view, axes.across, min);
  const unsigned texture = viewer.Slice({.picture = world_axis,
                                         .axes = axes,
                                         .position_voxels = state.cross_I[axes.across.axis],
                                         .size = pixels,
                                         .surface = state.surface,
                                         .cross_I = state.cross_I});
  const ImVec2 max = {min.x + size.x, min.y + size.y};
  ImGui::GetWindowDrawList()->AddImage(
      reinterpret_cast<ImTextureID>(static_cast<std::uintptr_t>(texture)), min, max, {0.0f, 1.0f},
      {1.0f, 0.0f});
  const SliceAxes in_world = SliceInWorld(world_axis, state.slice_side);
  DrawCaption(in_world, axes.across, state, X_WI, min);
  if (state.overlay.letters) DrawLetters(in_world, min, size);
}

}  // namespace

void DrawSlices(Viewer& viewer, const Area& area) {
  // The pictures are dark in both themes.
  const ThemeScope dark(Theme::kDark);
  ImGui::PushStyleVar(ImGuiStyleVar_WindowPadding, {0.0f, 0.0f});
  ImGui::PushStyleVar(ImGuiStyleVar_ItemSpacing, {2.0f, 2.0f});
  BeginPanel("slices", area, ImGuiWindowFlags_NoScrollWithMouse);
  if (viewer.feed().volume().lattice()) {
    const ImVec2 size{std::floor((area.size.x - 4.0f) / 3.0f), area.size.y};
    for (int world_axis = 0; world_axis < 3; ++world_axis) {
      if (world_axis > 0) ImGui::SameLine();
      DrawSlice(viewer, world_axis, size);
    }
    ImGui::PopStyleVar(2);
    const char* label = "Follow the proxy (C)";
    const ImVec2 text = ImGui::CalcTextSize(label);
    ImGui::SetCursorPos(
        {area.size.x - text.x - 40.0f, area.size.y - ImGui::GetFrameHeight() - 4.0f});
    bool& follows = viewer.state().cross_follows_proxy;
    if (!follows) {
      ImGui::Checkbox(label, &follows);
      Tip("the cross-hair goes with the stylus again");
    }
  } else {
    ImGui::PopStyleVar(2);
  }
  ImGui::End();
}

}  // namespace palpate::view
