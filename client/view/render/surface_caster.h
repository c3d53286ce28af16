// Casts a ray per pixel through the volume: the exact trilinear isosurface V, a veil in front of
// it, and cuts by crop box and planes.
//
// A ray goes through blocks, cell bricks and then cells by integer steps, so that it misses no cell
// at a border or along an axis. Within a cell, F along the ray is a cubic. Its first root is
// searched between the roots of its derivative. The ray carries its side of the isovalue from cell
// to cell. A change of side is a hit, even with rounding at the border.
//
// The result is kept in textures of the image's size. It is cast again only if the request or the
// volume has changed. If only missing bricks have come, the pixels that want them are cast again.
//
// A cast of all pixels may take seconds in software. CastRows casts a picture in parts, beside the
// one that is shown.
//
// Threads: that of the current OpenGL 4.3 context. Errors: kTooLarge for a size that the context
// does not support (nothing has changed then); kInternal if the driver refuses a shader.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/view_options.h"
#include "client/view/render/brick_cache.h"
#include "client/view/render/shader_program.h"

namespace palpate::view {

// The most blended layers of the veil. Layers behind are left out.
inline constexpr int kMostVeilLayers = 16;

struct CastRequest {
  ImageSize size;
  Vec3 eye_D = Vec3::Zero();
  Mat4 clip_from_D = Mat4::Identity();
  SurfaceOptions surface;
  friend bool operator==(const CastRequest&, const CastRequest&) = default;
};

class SurfaceCaster {
 public:
  SurfaceCaster();
  ~SurfaceCaster();
  SurfaceCaster(const SurfaceCaster&) = delete;
  SurfaceCaster& operator=(const SurfaceCaster&) = delete;

  // Returns false if the result is already there, or the size is 0. Leaves its own framebuffer
  // bound. A volume without a place is not shown. Marks the bricks that the picture wants.
  bool Cast(BrickCache& volume, const CastRequest& request);

  // Casts the next `rows` rows, at least one, of the next picture. Another request, or changed
  // voxels, begin it anew. The shown picture, and what it wants of the volume, stay until the next
  // one is whole.
  enum class Progress {
    kMore,   // rows are left
    kWaits,  // for the volume's TakeUp: the picture wants bricks
    kWhole,  // it is shown, as if Cast had been called
  };
  Progress CastRows(BrickCache& volume, const CastRequest& request, int rows);

  // Names of textures of the shown request's size; the first row is the bottom.
  unsigned color() const;       // RGBA8, alpha 0: no surface
  unsigned depth() const;       // R32F as clip_from_D gives it; 1: none
  unsigned veil_color() const;  // RGBA8, premultiplied by alpha
  unsigned veil_depth() const;  // R32F, of the nearest layer; 1: none
  // Of all pixels.
  std::uint64_t casts() const { return casts_; }

 private:
  struct Casting;

  void MaskFinished(const Casting& picture) const;
  void Draw(const Casting& picture, const BrickCache& volume, const CastRequest& request);
  void CastTo(Casting& picture, BrickCache& volume, const CastRequest& request, int end_row,
              BrickCache::Marks marks);
  Progress ShowNext();

  std::map<std::size_t, VolumePrograms> programs_;  // by the number of veils
  ShaderProgram mask_program_;
  std::unique_ptr<Casting> shown_;
  std::unique_ptr<Casting> next_;  // by CastRows
  std::uint64_t casts_ = 0;
};

}  // namespace palpate::view
