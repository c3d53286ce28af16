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
#include "client/view/render/shader_program.h"
#include "client/view/render/volume_texture.h"

namespace palpate::view {

class SliceDrawing {
 public:
  SliceDrawing();
  SliceDrawing(const SliceDrawing&) = delete;
  SliceDrawing& operator=(const SliceDrawing&) = delete;

  // Without a volume, the picture is empty. Does nothing if the picture already shows this request.
  void Draw(const VolumeTexture& volume, const SliceRequest& request);
  // The bottom row is first.
  const FrameTarget& picture(int number) const { return pictures_[number]; }
  std::uint64_t casts() const { return casts_; }

 private:
  // The state that a picture shows.
  struct Drawn {
    SliceRequest request;
    std::uint64_t version = 0;  // of the volume
    friend bool operator==(const Drawn&, const Drawn&) = default;
  };

  void Cast(const VolumeTexture& volume, const SliceRequest& request);
  void SetVolume(const VolumeTexture& volume, const SliceRequest& request) const;
  void SetColors(const SurfaceOptions& surface, const ValueScale& scale);

  ShaderProgram program_;
  ColorTexture color_table_;
  std::array<FrameTarget, 3> pictures_;
  std::array<std::optional<Drawn>, 3> drawn_;
  std::uint64_t casts_ = 0;
};

}  // namespace palpate::view
