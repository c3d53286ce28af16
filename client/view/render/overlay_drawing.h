// Draws an overlay into a frame that already has the surface.
//
// In front of the surface, the overlay is opaque. Behind the surface, it has the alpha of its
// vertices, so that a hidden proxy stays visible. The frame's veil tints everything behind the
// veil's nearest layer.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of ShaderProgram.
#pragma once

#include "client/view/drawing/overlay.h"
#include "client/view/render/shader_program.h"

namespace palpate::view {

struct OverlayView {
  ImageSize size;
  Mat4 clip_from_D = Mat4::Identity();
  Vec3 eye_D = Vec3::Zero();
  // OpenGL names, as in SurfaceCaster; 0: no veil.
  unsigned veil_color = 0;
  unsigned veil_depth = 0;
};

class OverlayDrawing {
 public:
  OverlayDrawing();
  ~OverlayDrawing();
  OverlayDrawing(const OverlayDrawing&) = delete;
  OverlayDrawing& operator=(const OverlayDrawing&) = delete;

  // Draws into the bound framebuffer and tests its depth.
  void Draw(const Overlay& overlay, const OverlayView& view);

 private:
  void DrawSide(bool behind, const Overlay& overlay, const OverlayView& view) const;

  ShaderProgram solid_program_;
  ShaderProgram line_program_;
  unsigned solid_vertices_ = 0;
  unsigned solid_buffer_ = 0;
  unsigned line_vertices_ = 0;
  unsigned line_buffer_ = 0;
};

}  // namespace palpate::view
