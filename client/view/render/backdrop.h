// What a frame has before the overlay is drawn: background, surface, veil over it, and
// the surface's depth. Kept until the surface is cast again, so that a frame in which
// only the overlay moved begins with a copy.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of FrameTarget and
// ShaderProgram.
#pragma once

#include "client/view/render/frame_target.h"
#include "client/view/render/shader_program.h"
#include "client/view/render/surface_caster.h"

namespace palpate::view {

class Backdrop {
 public:
  Backdrop();

  // `surface` has been cast at this size, or is null: background alone.
  void Compose(const SurfaceCaster* surface, const ImageSize& size);

  // The depth is the surface's, 1 where there is none.
  const FrameTarget& target() const { return target_; }
  // Depths, 0 to 1 as clip_from_D gives them, the first row the bottom; one pixel of them.
  std::vector<float> ReadDepths() const;
  float ReadDepth(int x_px, int y_from_bottom_px) const;

 private:
  ShaderProgram program_;
  FrameTarget target_{FrameTarget::Depth::kFloat};
};

}  // namespace palpate::view
