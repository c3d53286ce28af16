// Measuring with the pointer: two clicks, in the view or in slices, are a distance.
//
// Threads: that of the frames.
#pragma once

#include <imgui.h>

#include <functional>
#include <optional>

#include "client/view/viewer/viewer.h"

namespace palpate::view {

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
