// Draws slices across the axes of the lattice: values through the colour map, isolines, a
// cross-hair. drawing/slice_view.h maps a slice to its picture.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of FrameTarget and ShaderProgram.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "client/view/drawing/patient_axes.h"
#include "client/view/drawing/slice_view.h"
#include "client/view/drawing/view_options.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/shader_program.h"

namespace palpate::view {

// A slice across an axis of the lattice, at a voxel coordinate along the axis. drawing/slice_view.h
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

class SliceDrawing {
 public:
  SliceDrawing();
  SliceDrawing(const SliceDrawing&) = delete;
  SliceDrawing& operator=(const SliceDrawing&) = delete;

  // Without a volume, the picture is empty. Does nothing if the picture already shows this request.
  // Marks the bricks that the picture wants.
  void Draw(BrickCache& volume, const SliceRequest& request);
  // The bottom row is first.
  const FrameTarget& picture(int number) const { return pictures_[number].target; }
  // Without those for bricks that came later.
  std::uint64_t casts() const { return casts_; }

 private:
  struct Picture {
    FrameTarget target;
    // What the target shows.
    std::optional<SliceRequest> request;
    std::uint64_t content_version = 0;  // of the volume
    std::uint64_t version = 0;          // of the volume
    std::size_t missing = 0;            // bricks that the picture wants
  };

  void Cast(const BrickCache& volume, const SliceRequest& request, const FrameTarget& target);

  VolumePrograms programs_;
  std::array<Picture, 3> pictures_;
  std::uint64_t casts_ = 0;
};

}  // namespace palpate::view
