// The part of a frame behind the overlay: background, surface, veil, and the surface's depth. It is
// kept until the surface is cast again. If only the overlay moves, a frame starts with a copy.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of FrameTarget and ShaderProgram.
#pragma once

#include "client/view/render/frame_target.h"
#include "client/view/render/shader_program.h"
#include "client/view/render/surface_caster.h"

namespace palpate::view {

class Backdrop {
 public:
  Backdrop();

  // `surface` must have been cast at this size. If null, only the background is drawn.
  void Compose(const SurfaceCaster* surface, const ImageSize& size);

  // The depth is the surface's; 1 where there is no surface.
  const FrameTarget& target() const { return target_; }
  // Read all depths or one: 0 to 1 as clip_from_D gives them, the bottom row first.
  std::vector<float> ReadDepths() const;
  float ReadDepth(int x_px, int y_from_bottom_px) const;

 private:
  ShaderProgram program_;
  FrameTarget target_{FrameTarget::Depth::kFloat};
};

}  // namespace palpate::view
