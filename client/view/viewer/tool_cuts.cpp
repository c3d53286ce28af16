#include "client/view/viewer/tool_cuts.h"

#include <imgui.h>

#include "client/view/viewer/viewer.h"

namespace palpate::view {
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

}  // namespace palpate::view
