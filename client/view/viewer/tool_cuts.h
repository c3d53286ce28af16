// Drags of the handles of crop box and clip planes in the view.
//
// Threads: that of the frames.
#pragma once

#include <array>
#include <optional>

#include "client/view/drawing/cut_handles.h"

namespace palpate::view {

class Viewer;
struct ViewPointer;

struct CutsState {
  int panel_frame = -2;  // Dear ImGui's frame that drew the panel last
  bool in_use = false;   // the panel is open: handles are shown
  // True for planes that the user has placed: their offsets are valid.
  std::array<bool, kClipPlanes> planes_placed{};
  std::array<Vec3, kClipPlanes> pivots_I{};  // as in CutScene
  std::optional<CutHandle> under_pointer{};
  std::optional<CutDrag> drag{};
};

// None: no volume is known.
std::optional<CutScene> CutSceneOf(const Viewer& viewer);
// The handle to draw lit up.
std::optional<CutHandle> LitHandle(const CutsState& state);

// Like the tools in tool.h, which it precedes: a drag that begins on a handle moves the handle.
bool TakeCutHandles(Viewer& viewer, const ViewPointer& pointer);

}  // namespace palpate::view
