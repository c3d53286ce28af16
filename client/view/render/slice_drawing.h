// Draws slices across the axes of the lattice: values through the colour map, isolines, a
// cross-hair. scene/slice_view.h maps a slice to its picture.
//
// Threads: that of the current OpenGL 4.3 context. Errors: those of FrameTarget and ShaderProgram.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "client/view/render/color_texture.h"
#include "client/view/render/frame_renderer.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/volume_programs.h"

namespace palpate::view {

class SliceDrawing {
 public:
  SliceDrawing();
  SliceDrawing(const SliceDrawing&) = delete;
  SliceDrawing& operator=(const SliceDrawing&) = delete;

  // Without a volume, the picture is empty. Does nothing if the picture already shows this request.
  // Marks the bricks that the picture wants.
  void Draw(BrickCache& volume, const SliceRequest& request);
  // The bottom row is first.
  const FrameTarget& picture(int number) const { return pictures_[number]; }
  // Without those for bricks that came later.
  std::uint64_t casts() const { return casts_; }

 private:
  // The state that a picture shows.
  struct Drawn {
    SliceRequest request;
    std::uint64_t content_version = 0;  // of the volume
    friend bool operator==(const Drawn&, const Drawn&) = default;
  };

  struct Missing {
    std::size_t bricks = 0;     // that the picture wants
    std::uint64_t version = 0;  // of the volume then
  };

  void Cast(const BrickCache& volume, const SliceRequest& request);

  VolumePrograms programs_;
  ColorTexture color_table_;
  std::array<FrameTarget, 3> pictures_;
  std::array<std::optional<Drawn>, 3> drawn_;
  std::array<Missing, 3> missing_;
  std::uint64_t casts_ = 0;
};

}  // namespace palpate::view
