// Everything on the screen: view and panels, by Dear ImGui. A window or an offscreen
// program feeds it.
//
// Threads: that of the current OpenGL context, which outlives it. One at a time.
#pragma once

#include <vector>

#include "client/view/app/input.h"
#include "client/view/app/viewer.h"

namespace palpate::view {

class Interface {
 public:
  // `scale`: 1 on screens of about 100 pixels per inch.
  explicit Interface(float scale);
  ~Interface();
  Interface(const Interface&) = delete;
  Interface& operator=(const Interface&) = delete;

  // One frame, once Dear ImGui knows pointer and size: lays out and draws into the
  // framebuffer that is 0 (the window) or a name of OpenGL.
  void DrawFrame(Viewer& viewer, const std::vector<KeyPress>& keys, const ImageSize& pixels,
                 unsigned framebuffer);
  // The view of the last frame.
  const ImageSize& view_pixels() const { return view_pixels_; }

 private:
  float scale_;
  ImageSize view_pixels_;
};

// What was drawn into the framebuffer that is bound for reading.
Image ReadPixels(const ImageSize& size);

}  // namespace palpate::view
