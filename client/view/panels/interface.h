// The whole screen, view and panels, by Dear ImGui. A window or an offscreen program gives it the
// input.
//
// Threads: that of the current OpenGL context, which must outlive it. One at a time.
#pragma once

#include <vector>

#include "client/view/panels/input.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

class Interface {
 public:
  // `screen_scale`: 1 on screens of about 100 pixels per inch.
  explicit Interface(float screen_scale);
  ~Interface();
  Interface(const Interface&) = delete;
  Interface& operator=(const Interface&) = delete;

  // Lays out and draws one frame. Call it when Dear ImGui knows pointer and size. Draws into the
  // given framebuffer: 0 (the window) or an OpenGL name.
  void DrawFrame(Viewer& viewer, const std::vector<KeyPress>& keys, const ImageSize& pixels,
                 unsigned framebuffer);
  // The size of the view in the last frame.
  const ImageSize& view_pixels() const { return view_pixels_; }

 private:
  // Font and colours as the user wants them.
  void TakeLook(const Preferences& wanted);
  float Scale() const { return screen_scale_ * static_cast<float>(font_percent_) / 100.0f; }

  float screen_scale_;
  // As font and colours are.
  int font_percent_ = Preferences().font_percent;
  Theme theme_ = Preferences().theme;
  ImageSize view_pixels_;
};

}  // namespace palpate::view
