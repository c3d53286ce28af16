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
#include <memory>
#include <optional>
#include <vector>

#include "client/view/scene/camera.h"
#include "client/view/scene/overlay.h"
#include "client/view/scene/patient_axes.h"
#include "client/view/scene/slice_view.h"
#include "client/view/scene/view_options.h"
#include "client/view/volume/view_volume.h"

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

// A slice across an axis of the lattice, at a voxel coordinate along the axis. scene/slice_view.h
// maps the slice to its picture.
struct SliceRequest {
  int picture = 2;                                             // 0 to 2: the picture that shows it
  SliceAxes axes = SliceInWorld(2, SliceSide::kRadiological);  // of I
  double position_voxels = 0.0;
  ImageSize size;
  SurfaceOptions surface;         // colour map, window, isovalue (drawn as a line)
  std::optional<Vec3> cross_I{};  // the cross-hair
  SliceZoom zoom{};
  friend bool operator==(const SliceRequest&, const SliceRequest&) = default;
};

class FrameRenderer {
 public:
  // The budget is for the volume, without pictures.
  explicit FrameRenderer(std::size_t budget_bytes = std::size_t{1} << 30);
  ~FrameRenderer();
  FrameRenderer(const FrameRenderer&) = delete;
  FrameRenderer& operator=(const FrameRenderer&) = delete;

  // Takes up the volume's changes. Uploads at most `most_bricks` of the bricks that the last
  // pictures want, so that a large volume does not stop the window. Returns true if none is left.
  // Pictures are coarser where bricks are missing. A picture is whole if TakeUp changes nothing
  // after it: see volume_version.
  bool TakeUp(ViewVolume& volume, std::size_t most_bricks);
  // Rises with every change of the volume on the graphics card.
  std::uint64_t volume_version() const;
  // True if the last pictures want more bricks than the budget holds: they are coarser where far.
  bool is_full() const;

  // Draws into a picture of its own. DrawnTexture returns it until the next Draw.
  void Draw(const FrameRequest& request);
  // Casts the surface of a request in parts, for about `time`, beside the picture that Draw shows.
  // Returns true once the surface is whole: then Draw of the same request does not cast. For views
  // whose cast would stop the window.
  bool Prepare(const FrameRequest& request, std::chrono::milliseconds time);
  unsigned DrawnTexture() const;  // OpenGL name; RGBA8, the bottom row is first
  Image ReadBack() const;
  // Rises with every change of the surface that SurfaceAt and SurfaceDistances return.
  std::uint64_t surface_version() const;
  // The number of casts of all pixels so far, for tests and for the cost of a frame.
  std::uint64_t casts() const;

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
  std::uint64_t slice_casts() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace palpate::view
