// One slice on the screen, with what the pointer does in it.
//
// Threads: that of the frames, within a frame of Dear ImGui.
#pragma once

#include "client/view/viewer/layout.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

// Moves the slices' cross-hair, which then no longer follows the stylus.
void MoveCross(Viewer& viewer, const Vec3& cross_I);
// Zooms the slice under the pointer about its middle, for keys. Does nothing elsewhere.
void ZoomPointedSlice(Viewer& viewer, double factor);

}  // namespace palpate::view
