// What a drag with the left button does in the view. One tool has the pointer at a time.
//
// Threads: that of the frames.
#pragma once

#include <vector>

#include "client/view/drawing/camera.h"
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

}  // namespace palpate::view
