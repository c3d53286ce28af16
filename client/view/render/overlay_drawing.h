// Draws an overlay into a frame that has the surface already.
//
// In front of the surface it is drawn as it is. Where the surface hides it, as much of
// it is drawn as its vertices say, so that a proxy behind the surface is never lost. The
// veil, which the frame has too, tints what lies behind its nearest layer.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of ShaderProgram.
#pragma once

#include "client/view/render/shader_program.h"
#include "client/view/scene/overlay.h"

namespace palpate::view {

struct OverlayView {
  ImageSize size;
  Mat4 clip_from_D = Mat4::Identity();
  Vec3 eye_D = Vec3::Zero();
  // GL names as SurfaceCaster has them; 0: no veil.
  unsigned veil_color = 0;
  unsigned veil_depth = 0;
};

class OverlayDrawing {
 public:
  OverlayDrawing();
  ~OverlayDrawing();
  OverlayDrawing(const OverlayDrawing&) = delete;
  OverlayDrawing& operator=(const OverlayDrawing&) = delete;

  // Into the bound framebuffer, whose depth is tested.
  void Draw(const Overlay& overlay, const OverlayView& view);

 private:
  enum class Side { kBehind, kInFront };
  void DrawSide(Side side, const Overlay& overlay, const OverlayView& view) const;

  ShaderProgram solid_program_;
  ShaderProgram line_program_;
  unsigned solid_vertices_ = 0;
  unsigned solid_buffer_ = 0;
  unsigned line_vertices_ = 0;
  unsigned line_buffer_ = 0;
};

}  // namespace palpate::view
