// What is drawn over the view and the slices, and the parts of it that take the pointer.
//
// Threads: that of the frames, within a frame of Dear ImGui.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "client/view/drawing/readout.h"
#include "client/view/viewer/layout.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

// Text on a ground, so that it can be read on any picture.
struct Label {
  std::string text{};
  ImU32 color = IM_COL32(255, 255, 255, 255);
  ImU32 ground = IM_COL32(15, 17, 20, 200);
  float wrap_px = 0.0f;  // the longest line; 0: lines are as long as in the text
};
ImVec2 SizeOf(const Label& label);  // without the margin
// `at`: the upper left corner of the text.
void DrawLabel(ImDrawList& list, const ImVec2& at, const Label& label, float scale);

// The orientation cube, and below it the question where the patient faces. Call TakeCube before the
// view's own item, because the first item under the pointer has it.
void TakeCube(Viewer& viewer, const Area& view, float scale);
void DrawCube(const Viewer& viewer, const Area& view, float scale);
// Looks from a side of the volume: keys 1 to 6, see SideOfKey.
void LookFromKey(Viewer& viewer, int key);

// Scale bar, distances, and what is under the pointer, in the view.
void DrawViewMarks(Viewer& viewer, const Area& view, float below, float scale);
// `right_top`: the corner beside which the bar is drawn.
void DrawScaleBar(const ScaleBar& bar, const ImVec2& right_top, float scale);
// Value and place of a point of the volume.
std::string Readout(const Viewer& viewer, const Vec3& p_I, const char* between);

// Distances, in a picture that shows points of W where `on_screen` says (none: not in it).
// `strength`: how visible the line of a distance is, 0 to 1.
struct MeasurePicture {
  std::function<std::optional<Eigen::Vector2d>(const Vec3& p_W)> on_screen;
  std::function<double(const Distance& distance)> strength;
  float scale = 1.0f;  // of the layout
};
// `pointed_W`: where the next point would be, if the pointer is in this picture.
void DrawMeasures(const MeasureState& measure, const MeasurePicture& picture,
                  const std::optional<Vec3>& pointed_W);

}  // namespace palpate::view
