// Draws a volume and what the haptic loop does in it: isosurface, veil, cuts, overlay. The surface
// and its depth are kept. They are cast again only if the camera, the volume or an option has
// changed. So a moved proxy costs almost nothing.
//
// Threads: that of a current OpenGL 4.3 core context, which must outlive the renderer. It may
// change any state of the context, but no objects of others.
// Errors: kTooLarge for a volume of which the context does not even hold a coarse level, and for a
// picture beyond its 2-D textures or viewports; the last picture then stays. kInternal if the
// driver refuses a shader. The renderer can be used after any error.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "client/view/render/brick_cache.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/overlay_drawing.h"
#include "client/view/render/shader_program.h"
#include "client/view/render/slice_drawing.h"
#include "client/view/render/surface_caster.h"

namespace palpate::view {

struct FrameRequest {
  ImageSize size;
  Camera camera;
  SurfaceOptions surface;
  const Overlay* overlay = nullptr;  // may be null
};

// A row of a picture is `width` pixels of red, green, blue, alpha. The top row is first.
struct Image {
  ImageSize size;
  std::vector<std::uint8_t> rgba;
};

class FrameRenderer {
 public:
  // The budget is for the volume, without pictures.
  explicit FrameRenderer(std::size_t budget_bytes = std::size_t{1} << 30);
  FrameRenderer(const FrameRenderer&) = delete;
  FrameRenderer& operator=(const FrameRenderer&) = delete;

  // Takes up the volume's changes. Uploads at most `most_bricks` of the bricks that the last
  // pictures want, so that a large volume does not stop the window. Returns true if none is left.
  // Pictures are coarser where bricks are missing. A picture is whole if TakeUp changes nothing
  // after it: see volume_version.
  bool TakeUp(ViewVolume& volume, std::size_t most_bricks);
  // Rises with every change of the volume on the graphics card.
  std::uint64_t volume_version() const { return volume_.version(); }
  // True if the last pictures want more bricks than the budget holds: they are coarser where far.
  bool is_full() const { return volume_.is_full(); }

  // Draws into a picture of its own. DrawnTexture returns it until the next Draw.
  void Draw(const FrameRequest& request);
  // Casts the surface of a request in parts, for about `time`, beside the picture that Draw shows.
  // Returns true once the surface is whole: then Draw of the same request does not cast. For views
  // whose cast would stop the window.
  bool Prepare(const FrameRequest& request, std::chrono::milliseconds time);
  // OpenGL name; RGBA8, the bottom row is first.
  unsigned DrawnTexture() const { return frame_.color(); }
  Image ReadBack() const { return {frame_.size(), frame_.ReadColors()}; }
  // Rises with every change of the surface that SurfaceAt and SurfaceDistances return.
  std::uint64_t surface_version() const { return surface_version_; }
  // The number of casts of all pixels so far, for tests and for the cost of a frame.
  std::uint64_t casts() const { return caster_.casts(); }

  // Returns the surface under a pixel of the last Draw, without overlays; none: background. Frame:
  // D.
  std::optional<Vec3> SurfaceAt(int x_px, int y_px) const;
  // The distance of all pixels from the eye in mm, the top row first; infinite where there is no
  // surface. For tests.
  std::vector<float> SurfaceDistances() const;

  // Draws a slice into the texture of its picture and returns the texture's OpenGL name. Draws only
  // if the request or the volume has changed.
  unsigned DrawSlice(const SliceRequest& request);
  Image ReadSlice(int picture) const;
  // The slices are hidden: what they want need not stay in graphics memory.
  void ForgetSlices();
  // The number of slices drawn so far.
  std::uint64_t slice_casts() const { return slices_.casts(); }

 private:
  void UpdateBackdrop(const FrameRequest& request);
  void ComposeBackdrop(bool with_surface, const ImageSize& size);

  BrickCache volume_;
  SurfaceCaster caster_;
  // What is behind the overlay: background, surface, veil, and the surface's depth, which is 1
  // where there is none. If only the overlay moves, a frame starts with a copy of it.
  FrameTarget backdrop_{FrameTarget::Depth::kFloat};
  ShaderProgram backdrop_program_;
  FrameTarget frame_{FrameTarget::Depth::kFloat};
  OverlayDrawing overlay_;
  SliceDrawing slices_;
  // Set by the last Draw.
  Mat4 clip_from_D_ = Mat4::Identity();
  Vec3 eye_D_ = Vec3::Zero();
  bool surface_shown_ = false;
  std::uint64_t composed_casts_ = 0;  // of the caster, when the backdrop was composed
  std::uint64_t surface_version_ = 0;
  double rows_per_ms_ = 0.2;  // of Prepare
};

}  // namespace palpate::view
