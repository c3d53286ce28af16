// What a drag with the left button does in the view. One tool has the pointer at a time.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/cut_handles.h"
#include "client/view/drawing/distances.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

class Viewer;

enum class Tool {
  kTurn,     // turns the view
  kHand,     // leads the simulated hand
  kBrush,    // edits the volume
  kMeasure,  // measures distances
};

// The pointer in the view, in this frame.
struct ViewPointer {
  ImageSize size;         // of the view, in pixels of the picture
  Eigen::Vector2d at_px;  // from the view's upper left corner
  // Where the pointer was since the last frame; the last place is at_px.
  std::vector<Eigen::Vector2d> way_px;
  bool hovered = false;
  bool clicked = false;  // the left button went down on the view
  bool held = false;     // the left button is down since a click on the view
  bool shift = false;
  bool ctrl = false;
  double wheel_steps = 0.0;
};

// Each, and HandTool::Take, returns true if the tool has used the pointer, so that it does not turn
// or zoom the view.
// Call them in each frame, also for the tools that are not chosen: a tool lets go of the pointer
// when another tool was chosen.
bool TakeBrush(Viewer& viewer, const ViewPointer& pointer);
bool TakeMeasure(Viewer& viewer, const ViewPointer& pointer);

// Makes the brush's radius this many steps greater.
void GrowBrush(Viewer& viewer, double steps);

// Drags of the handles of crop box and clip planes in the view.
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

// Like the tools above, which it precedes: a drag that begins on a handle moves the handle.
bool TakeCutHandles(Viewer& viewer, const ViewPointer& pointer);

// Measuring with the pointer: two clicks, in the view or in slices, are a distance.
//
// The pointer in a picture, in which points of W can be measured. Pixels of this picture.
struct MeasurePointer {
  int picture = 0;  // tells pictures apart: where the button went down, it must go up
  Eigen::Vector2d at_px;
  bool clicked = false;  // the left button went down
  bool held = false;     // it is down since
  // The point under the pointer, asked for only when needed; none: nothing is there.
  std::function<std::optional<Vec3>()> point_W;
  PixelOfPoint pixel_of;
  PixelOfPoint end_of{};  // of ends that can be dragged; empty: pixel_of
};

// Does nothing unless Tool::kMeasure is chosen. Returns true if the pointer is used: until it moves
// as a drag, which may then turn the view. Dear ImGui's current item must be the picture: a right
// click on it removes a distance.
bool TakeMeasurePointer(Viewer& viewer, const MeasurePointer& pointer);

// Dear ImGui's current item was clicked, without a drag. `scale`: of the layout.
bool IsClicked(float scale, ImGuiMouseButton button = ImGuiMouseButton_Left);

}  // namespace palpate::view
