// Draws a view of a volume and of what the haptic loop does in it: isosurface, veil,
// cuts, overlay. The surface with its depth is kept, and cast again only where the
// camera, the volume or an option changed, so that a moved proxy costs next to nothing.
//
// Threads: that of a current OpenGL 4.3 core context, which must outlive it. State of
// the context that is changed: all but the objects of others.
// Errors: Error with kTooLarge for volumes beyond the context's 3-D textures, and for
// pictures beyond its 2-D textures or viewports, which leave the last picture as it is;
// kInternal where a shader is refused. It can be used further after any.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "client/view/scene/camera.h"
#include "client/view/scene/overlay.h"
#include "client/view/scene/view_options.h"
#include "client/view/volume/view_volume.h"

namespace palpate::view {

struct FrameRequest {
  ImageSize size;
  Camera camera;
  SurfaceOptions surface;
  const Overlay* overlay = nullptr;  // may be null
};

// A row of a picture is `width` pixels of red, green, blue, alpha; the first is the top.
struct Image {
  ImageSize size;
  std::vector<std::uint8_t> rgba;
};

// A slice across an axis of the lattice, at a voxel coordinate along it. How it lies in
// its picture, and which point is at a pixel: scene/slice_view.h.
struct SliceRequest {
  int axis = 2;  // 0 x, 1 y, 2 z
  double position_voxels = 0.0;
  ImageSize size;
  SurfaceOptions surface;         // colour map, window, isovalue (drawn as a line)
  std::optional<Vec3> cross_I{};  // the cross-hair
  friend bool operator==(const SliceRequest&, const SliceRequest&) = default;
};

class FrameRenderer {
 public:
  FrameRenderer();
  ~FrameRenderer();
  FrameRenderer(const FrameRenderer&) = delete;
  FrameRenderer& operator=(const FrameRenderer&) = delete;

  // Takes up changed bricks, at most `most_bricks` of them, so that a large volume
  // does not halt the window. True where nothing is left.
  // Pictures in between show what is up, and what was there before elsewhere.
  bool TakeUp(ViewVolume& volume, std::size_t most_bricks);
  // Changed bricks that the last TakeUp left for later.
  std::size_t waiting_bricks() const;

  // Into a picture of its own, which DrawnTexture names until the next Draw.
  void Draw(const FrameRequest& request);
  unsigned DrawnTexture() const;  // GL name; RGBA8, its first row is the bottom
  Image ReadBack() const;
  // Casts since it was made: for tests, and to see what a frame costs.
  std::uint64_t casts() const;

  // The surface under a pixel of the last Draw, overlays aside; none: background.
  // Frame: D.
  std::optional<Vec3> SurfaceAt(int x_px, int y_px) const;
  // Depth of all pixels as the distance from the eye in mm, first row the top;
  // infinite where there is no surface. For tests.
  std::vector<float> SurfaceDistances() const;

  // Slice into a texture of its own, one per axis; returns its GL name. Drawn again only
  // where its request or the volume changed.
  unsigned DrawSlice(const SliceRequest& request);
  Image ReadSlice(int axis) const;
  // Slices drawn since it was made, as casts.
  std::uint64_t slice_casts() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::view
